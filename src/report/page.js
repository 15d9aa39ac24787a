'use strict';
// The report's page: unpacks the tables that it holds and draws them. Nothing is computed that a table does not say, but for the choice of rows.
(async () => {
  const byId = (id) => document.getElementById(id);
  const packed = Uint8Array.from(atob(byId('data').textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  const report = JSON.parse(await new Response(stream).text());

  // Okabe and Ito's palette, told apart by colour-blind eyes; then other shapes of line.
  const COLOURS = ['#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#8c6d00', '#7f7f7f'];
  const DASHES = ['solid', 'dashed', 'dotted'];
  const SYMBOLS = ['circle', 'rect', 'triangle', 'diamond'];
  const dark = window.matchMedia('(prefers-color-scheme: dark)');

  // ---- tables -------------------------------------------------------------------------------------------------------------------

  class Table {
    constructor(raw) {
      this.rows = raw ? raw.rows : 0;
      this.columns = Object.fromEntries((raw?.columns ?? []).map((column) => [column.name, column]));
    }
    has(name) { return name in this.columns; }
    unit(name) { return this.columns[name]?.unit ?? '1'; }
    at(name, row) {
      const column = this.columns[name];
      if (!column) return null;
      if (column.words) return column.at[row] < 0 ? null : column.words[column.at[row]];
      return column.values[row];
    }
    isNumber(name) { return !!this.columns[name]?.values && this.columns[name].values.some((v) => typeof v === 'number'); }
    values(name) { return Array.from({ length: this.rows }, (_, row) => this.at(name, row)); }
    // Rows by the value of a column.
    by(name) {
      const rows = new Map();
      for (let row = 0; row < this.rows; row++) {
        const key = this.at(name, row);
        if (!rows.has(key)) rows.set(key, []);
        rows.get(key).push(row);
      }
      return rows;
    }
  }
  const tables = {};
  for (const name of ['jobs', 'regularity', 'muscles', 'ratios', 'iterations', 'spectrum', 'optima', 'sensitivities', 'trajectories']) {
    tables[name] = new Table(report.tables[name]);
  }
  const { jobs, regularity, muscles, ratios, iterations, spectrum, trajectories } = tables;
  const of = Object.fromEntries(Object.entries(tables).map(([name, table]) => [name, table.has('job_id') ? table.by('job_id') : new Map()]));
  const old = report.beside ? { jobs: new Table(report.beside.tables.jobs), muscles: new Table(report.beside.tables.muscles) } : null;
  const distinct = (values) => [...new Set(values)].sort((a, b) => (typeof a === 'number' && typeof b === 'number' ? a - b : String(a) < String(b) ? -1 : 1));
  const axes = report.axes.filter((axis) => jobs.has(axis) && distinct(jobs.values(axis)).length > 1);
  const numberAxes = axes.filter((axis) => jobs.isNumber(axis));

  // ---- small pieces of page -----------------------------------------------------------------------------------------------------

  const make = (tag, attributes = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
      else if (value !== null && value !== undefined) element.setAttribute(name, value);
    }
    element.append(...children.filter((child) => child !== null && child !== undefined));
    return element;
  };
  const exact = (value) => (value === null || value === undefined ? '–' : String(value));
  // Seven digits for the eye; the title of a cell has them all.
  const short = (value) => (typeof value === 'number' && !Number.isInteger(value) ? String(Number(value.toPrecision(6))) : exact(value));
  const cell = (value, attributes = {}) =>
    make('td', { title: typeof value === 'number' ? exact(value) : null, class: typeof value === 'string' ? 'text' : null, ...attributes }, short(value));
  const withUnit = (name, unit) => (unit && unit !== '1' ? `${name}, ${unit}` : name);
  const select = (label, options, chosen, change) => {
    const element = make('select', { onchange: () => change(element.value) });
    for (const [value, text] of options) element.append(make('option', { value }, text));
    element.value = chosen;
    return make('label', {}, label, element);
  };
  const grid = (caption, header, rows) => make('div', { class: 'scroll' }, make('table', {},
    caption ? make('caption', {}, caption) : null,
    make('thead', {}, make('tr', {}, ...header.map((name) => make('th', { scope: 'col' }, name)))),
    make('tbody', {}, ...rows.map((row) => make('tr', {}, ...row.map((value) => (value instanceof Node ? value : cell(value))))))));

  // ---- plots --------------------------------------------------------------------------------------------------------------------

  const drawn = new Map();
  const look = () => {
    const style = getComputedStyle(document.documentElement);
    const ink = (name) => style.getPropertyValue(name).trim();
    return { ink: ink('--ink'), soft: ink('--soft'), line: ink('--line'), paper: ink('--paper') };
  };
  // A figure in `home`; `option` is made anew when the theme changes.
  const plot = (home, title, option, alt) => {
    const box = make('div', { class: 'plot', role: 'img', 'aria-label': alt ?? title });
    const save = make('button', { type: 'button', onclick: () => saveSvg(box, title), 'aria-label': `Save “${title}” as SVG` }, 'SVG');
    home.append(make('figure', {}, make('figcaption', {}, make('h3', {}, title), save), box));
    const chart = echarts.init(box, null, { renderer: 'svg' });
    const draw = () => {
      const { ink, soft, line, paper } = look();
      const axis = { axisLine: { onZero: false, lineStyle: { color: soft } }, axisLabel: { color: soft, hideOverlap: true }, nameTextStyle: { color: soft }, splitLine: { lineStyle: { color: line } } };
      const made = option();
      for (const side of ['xAxis', 'yAxis']) if (made[side]) made[side] = [].concat(made[side]).map((own) => ({ ...axis, nameLocation: 'middle', nameGap: side === 'xAxis' ? 26 : 46, ...own, axisLabel: { ...axis.axisLabel, ...own.axisLabel } }));
      chart.setOption({
        color: COLOURS, animation: false, aria: { enabled: true }, textStyle: { color: ink, fontFamily: 'system-ui, sans-serif' },
        grid: { left: 64, right: 14, top: 40, bottom: 44 },
        tooltip: { trigger: 'item', confine: true, backgroundColor: paper, borderColor: line, textStyle: { color: ink, fontSize: 12 } },
        legend: { type: 'scroll', top: 0, textStyle: { color: ink }, pageTextStyle: { color: ink }, pageIconColor: ink },
        ...made,
      }, true);
      if (alt) box.setAttribute('aria-label', alt);
    };
    draw();
    drawn.set(box, { chart, draw });
    return box;
  };
  const clear = (home) => {
    for (const box of home.querySelectorAll('.plot')) { drawn.get(box)?.chart.dispose(); drawn.delete(box); }
    home.replaceChildren();
  };
  const saveSvg = (box, title) => {
    const svg = drawn.get(box).chart.renderToSVGString();
    const link = make('a', { href: URL.createObjectURL(new Blob([svg], { type: 'image/svg+xml' })), download: `${report.study.name}-${title}.svg`.replace(/[^\w.-]+/g, '_') });
    link.click();
    URL.revokeObjectURL(link.href);
  };
  const redraw = () => drawn.forEach(({ draw }) => draw());
  dark.addEventListener('change', redraw);
  window.addEventListener('resize', () => drawn.forEach(({ chart }) => chart.resize()));
  const styled = (k) => ({ lineStyle: { type: DASHES[Math.floor(k / COLOURS.length) % DASHES.length], width: 2 }, symbol: SYMBOLS[k % SYMBOLS.length], symbolSize: 6, itemStyle: { color: COLOURS[k % COLOURS.length] } });
  const tip = (x, y) => (point) => `${point.seriesName}<br>${x}: ${exact(point.value[0])}<br>${y}: ${exact(point.value[2] ?? point.value[1])}`;
  // Lines [{name, points: [[x, y], …], dashed}] over a common axis; on a `log` axis by the exponent, nothing below 1e-16.
  const lines = (home, title, { x, y, series, log, symbols = true, extra = [] }) => plot(home, title, () => ({
    xAxis: { type: 'value', name: x, scale: true },
    yAxis: log ? { type: 'value', name: y, scale: true, axisLabel: { formatter: (v) => `1e${v}` } } : { type: 'value', name: y, scale: true },
    tooltip: { trigger: 'item', confine: true, formatter: tip(x, y) },
    series: [...extra, ...series.map((one, k) => {
      const style = styled(one.style ?? k);
      if (one.dashed) style.lineStyle = { ...style.lineStyle, type: 'dashed', opacity: 0.7 };
      const points = log ? one.points.filter(([, v]) => v > 0).map(([a, v]) => [a, Math.log10(Math.max(v, 1e-16)), v]) : one.points;
      return { name: one.name, type: 'line', data: points, showSymbol: symbols, ...style };
    })],
  }), `${title}: ${y} over ${x}, ${series.length} line(s): ${series.map((one) => one.name).join(', ')}`);

  // ---- what was asked, how it went ----------------------------------------------------------------------------------------------

  byId('description').textContent = report.study.description;
  const entry = (name, value) => make('dl', {}, make('dt', {}, name), make('dd', {}, value));
  const { study } = report;
  byId('asked').append(
    entry('Study', `${study.file} (${study.hash})`),
    entry('Model', `${study.model.file} (${study.model.hash})`),
    entry('Motion', `${study.motion.file} (${study.motion.hash.slice(0, 16)})`),
    entry('Solver', `sinew ${report.sinew.version}, ${report.sinew.solver}`),
    entry('Host', [report.host.name, report.host.os, report.host.arch, report.host.threads ? `${report.host.threads} thread(s)` : null].filter(Boolean).join(', ')),
    ...report.axes.map((axis) => {
      const values = jobs.has(axis) ? distinct(jobs.values(axis)) : [];
      const shown = values.length > 12 ? `${values.length} values, ${short(values[0])} to ${short(values[values.length - 1])}` : values.map(short).join(', ');
      return entry(`Swept: ${withUnit(axis, report.units[axis])}`, shown || 'no job is finished');
    }),
    entry('Fixed', Object.entries(report.base).filter(([, value]) => value !== null && !(Array.isArray(value) && !value.length)).map(([name, value]) => `${name} = ${typeof value === 'object' ? JSON.stringify(value) : value}`).join('; ')),
  );
  const statuses = jobs.by('status');
  const went = byId('went');
  const total = (name) => jobs.values(name).reduce((sum, value) => sum + (value ?? 0), 0);
  const counts = [...statuses].sort((a, b) => b[1].length - a[1].length).map(([status, rows]) => `${rows.length} ${status}`);
  went.append(make('p', { id: 'counts' }, jobs.rows
    ? `${jobs.rows} of ${report.planned} job(s) finished: ${counts.join(', ')}. ${short(total('wall_s'))} s in all.`
    : `None of ${report.planned} job(s) has finished, or its tables are not made yet (sinew merge makes them): there is nothing to draw.`));
  for (const note of report.notes) went.append(make('p', { class: 'soft' }, note));
  const failures = [];
  for (let row = 0; row < jobs.rows; row++) if (jobs.at('error', row)) failures.push([jobLink(row), jobs.at('status', row), jobs.at('error', row)]);
  if (failures.length) went.append(grid(`${failures.length} failed job(s)${failures.length > 50 ? ', the first 50' : ''}`, ['job', 'status', 'reason'], failures.slice(0, 50).map(([link, ...rest]) => [make('td', {}, link), ...rest])));
  if (regularity.has('loads_unique')) {
    const unique = regularity.values('loads_unique').filter(Boolean).length;
    went.append(make('p', {}, `Muscle loads are unique in ${unique} of ${regularity.rows} job(s) whose ranks are known.`));
  }

  function jobLink(row) { return make('a', { href: `#job=${jobs.at('job_id', row)}` }, exact(jobs.at('index', row))); }

  // ---- drift against a baseline -------------------------------------------------------------------------------------------------

  if (report.beside) {
    byId('s-drift').hidden = false;
    const { counts: changed, changes, gone, folder } = report.beside;
    byId('drift').append(make('p', {}, `Against ${folder}: ${Object.entries(changed).map(([kind, n]) => `${n} ${kind}`).join(', ') || 'no job in common'}.`));
    for (const name of gone) byId('drift').append(make('p', { class: 'bad' }, `${name} is in the baseline only.`));
    if (changes.length) {
      byId('drift').append(grid(`${changes.length} changed cell(s)`, ['job', 'table', 'row', 'column', 'baseline', 'now', 'tolerance'],
        changes.slice(0, 500).map((c) => [make('td', {}, make('a', { href: `#job=${c.job_id}` }, exact(c.job))), c.table, c.row, c.column, exact(c.baseline), exact(c.found), c.tolerance])));
    }
  }

  // ---- Table 1 ------------------------------------------------------------------------------------------------------------------

  const BOUNDS = [['activation', 'a ≥ 0'], ['excitation', 'u ≥ 0'], ['both', 'u, a ≥ 0']];
  const isTable1 = ['load_sharing_grid', 'bounds'].every((axis) => report.axes.includes(axis)) && regularity.rows > 0;
  if (isTable1) {
    byId('s-ranks').hidden = false;
    byId('ranks').append(make('p', {}, 'In brackets the thesis’ numbers, which hold for its own arm and h = 0.2. 0 is full rank.'));
    const others = report.axes.filter((axis) => axis !== 'load_sharing_grid' && axis !== 'bounds');
    const groups = new Map();
    for (let row = 0; row < jobs.rows; row++) {
      const key = others.map((axis) => `${axis} = ${short(jobs.at(axis, row))}`).join(', ');
      if (!groups.has(key)) groups.set(key, new Map());
      groups.get(key).set(`${jobs.at('load_sharing_grid', row)}/${jobs.at('bounds', row)}`, row);
    }
    for (const [key, cells] of [...groups].slice(0, 20)) {
      const rows = [];
      for (const [grid, title] of [['measurement', 'a at the measured instants'], ['collocation', 'a at the collocation points']]) {
        for (const [column, name] of [['deficiency_a', 'A'], ['deficiency_aj', '[Aᵀ Jᵀ]']]) {
          rows.push([`${title}, ${name}`, ...BOUNDS.map(([bounds]) => {
            const row = cells.get(`${grid}/${bounds}`);
            if (row === undefined) return make('td', {}, '–');
            const thesis = report.thesis.find((one) => one.grid === grid && one.bounds === bounds);
            const expected = column === 'deficiency_a' ? thesis.a : thesis.aj;
            const at = of.regularity.get(jobs.at('job_id', row))?.[0];
            const found = at === undefined ? null : regularity.at(column, at);
            const text = found === null ? jobs.at('status', row) : `${-found || 0} (${-expected || 0})`;
            return make('td', { class: found === expected ? null : 'bad', title: `${column} of job ${jobs.at('index', row)}: ${exact(found)}` }, make('a', { href: `#job=${jobs.at('job_id', row)}` }, text));
          })]);
        }
      }
      byId('ranks').append(grid(key || null, ['', ...BOUNDS.map(([, name]) => name)], rows));
    }
  }

  // ---- loads over the axes ------------------------------------------------------------------------------------------------------

  const muscleNames = muscles.rows ? distinct(muscles.values('muscle')) : [];
  const MEASURES = [['mean_force_n', 'mean force, N'], ['peak_force_n', 'peak force, N'], ['mean_activation', 'mean activation'], ['peak_activation', 'peak activation'], ['impulse_n_s', 'impulse, N s']].filter(([name]) => muscles.has(name));
  const ratioNames = ratios.rows ? [...new Set(Array.from({ length: ratios.rows }, (_, row) => `${ratios.at('ratio', row)} (${ratios.at('measure', row)})`))] : [];
  const choice = { measure: MEASURES[0]?.[0], x: numberAxes[numberAxes.length - 1], against: 'muscles', rest: {} };
  // Value of a measure of a muscle (or of a ratio) in a job, its interval, and where it came from.
  const muscleRow = new Map();
  for (let row = 0; row < muscles.rows; row++) muscleRow.set(`${muscles.at('job_id', row)}/${muscles.at('muscle', row)}`, row);
  const load = (job, muscle, measure) => {
    const row = muscleRow.get(`${jobs.at('job_id', job)}/${muscle}`);
    return row === undefined ? null : muscles.at(measure, row);
  };
  const chosenJobs = () => {
    const rows = [];
    for (let row = 0; row < jobs.rows; row++) {
      if (jobs.at('status', row) === 'converged' && Object.entries(choice.rest).every(([axis, value]) => String(jobs.at(axis, row)) === value)) rows.push(row);
    }
    return rows;
  };
  const drawLoads = () => {
    const home = byId('loads');
    clear(home);
    const { measure, x, against } = choice;
    const unit = MEASURES.find(([name]) => name === measure)[1];
    const rows = chosenJobs();
    const xName = withUnit(x, report.units[x]);
    const along = (value) => rows.map((row) => [jobs.at(x, row), value(row)]).filter(([a, b]) => a !== null && b !== null).sort((a, b) => a[0] - b[0]);
    if (against === 'muscles') {
      const many = muscleNames.length > 8;
      const groups = many ? muscleNames.map((name) => [name]) : [muscleNames];
      home.classList.toggle('small', many);
      for (const group of groups) {
        const bands = measure === 'mean_activation' ? group.flatMap((name, k) => band(rows, name, x, k)) : [];
        const series = group.map((name) => ({ name, points: along((row) => load(row, name, measure)) }));
        if (old) series.push(...group.map((name, k) => ({ name: `${name}, baseline`, style: k, dashed: true, points: oldPoints(name, x, measure) })).filter((one) => one.points.length));
        lines(home, many ? group[0] : 'All muscles', { x: xName, y: unit, series, extra: bands });
      }
      for (const name of ratioNames) {
        const value = (row) => (of.ratios.get(jobs.at('job_id', row)) ?? []).filter((r) => `${ratios.at('ratio', r)} (${ratios.at('measure', r)})` === name).map((r) => ratios.at('value', r))[0] ?? null;
        lines(home, `Ratio: ${name}`, { x: xName, y: 'ratio', series: [{ name, points: along(value) }] });
      }
    } else {
      home.classList.add('small');
      for (const name of muscleNames) heat(home, name, x, against, measure, unit);
    }
  };
  // Between the ends that mean activation may have to first order.
  const band = (rows, name, x, k) => {
    const ends = rows.map((row) => [jobs.at(x, row), load(row, name, 'mean_activation_low'), load(row, name, 'mean_activation_high')]).filter((e) => e.every((v) => v !== null)).sort((a, b) => a[0] - b[0]);
    if (!ends.some(([, low, high]) => high - low > 1e-9)) return [];
    const common = { type: 'line', stack: `band ${name}`, symbol: 'none', lineStyle: { opacity: 0 }, silent: true, tooltip: { show: false } };
    return [
      { ...common, name: `${name}, not unique`, data: ends.map(([a, low]) => [a, low]) },
      { ...common, name: `${name}, not unique`, data: ends.map(([a, low, high]) => [a, high - low]), areaStyle: { color: COLOURS[k % COLOURS.length], opacity: 0.25 } },
    ];
  };
  const oldPoints = (name, x, measure) => {
    if (!old.jobs.has(x) || !old.muscles.has(measure)) return [];
    const at = new Map(old.jobs.values('job_id').map((id, row) => [id, row]));
    const points = [];
    for (let row = 0; row < old.muscles.rows; row++) {
      const job = at.get(old.muscles.at('job_id', row));
      if (old.muscles.at('muscle', row) !== name || job === undefined) continue;
      if (Object.entries(choice.rest).every(([axis, value]) => String(old.jobs.at(axis, job)) === value)) points.push([old.jobs.at(x, job), old.muscles.at(measure, row)]);
    }
    return points.sort((a, b) => a[0] - b[0]);
  };
  const heat = (home, name, x, y, measure, unit) => {
    const rows = chosenJobs();
    const [xs, ys] = [x, y].map((axis) => distinct(rows.map((row) => jobs.at(axis, row))));
    const cells = rows.map((row) => [xs.indexOf(jobs.at(x, row)), ys.indexOf(jobs.at(y, row)), load(row, name, measure)]).filter((c) => c[2] !== null);
    const values = cells.map((c) => c[2]);
    plot(home, name, () => ({
      grid: { left: 64, right: 14, top: 14, bottom: 84 },
      xAxis: { type: 'category', data: xs.map(short), name: withUnit(x, report.units[x]) },
      yAxis: { type: 'category', data: ys.map(short), name: withUnit(y, report.units[y]) },
      legend: { show: false },
      tooltip: { confine: true, formatter: (p) => `${name}<br>${x}: ${exact(xs[p.value[0]])}<br>${y}: ${exact(ys[p.value[1]])}<br>${unit}: ${exact(p.value[2])}` },
      // Cividis, of one lightness for all eyes.
      visualMap: { min: Math.min(...values), max: Math.max(...values), calculable: true, orient: 'horizontal', left: 'center', bottom: 0, itemHeight: 90, textStyle: { color: look().ink }, inRange: { color: ['#00224e', '#35456c', '#666970', '#948e77', '#c8b866', '#fee838'] } },
      series: [{ type: 'heatmap', name, data: cells }],
    }), `${name}: ${unit} over ${x} and ${y}`);
  };
  const drawChoice = () => {
    const home = byId('loads-choice');
    home.replaceChildren(...[
      select('measure', MEASURES, choice.measure, (value) => { choice.measure = value; drawLoads(); }),
      select('over', numberAxes.map((axis) => [axis, withUnit(axis, report.units[axis])]), choice.x, (value) => { choice.x = value; begin(); }),
      numberAxes.length > 1 ? select('as', [['muscles', 'lines'], ...numberAxes.filter((axis) => axis !== choice.x).map((axis) => [axis, `map against ${axis}`])], choice.against, (value) => { choice.against = value; begin(); }) : null,
      ...axes.filter((axis) => axis !== choice.x && axis !== choice.against).map((axis) => select(axis, distinct(jobs.values(axis)).map((value) => [String(value), short(value)]), choice.rest[axis], (value) => { choice.rest[axis] = value; drawLoads(); })),
    ].filter(Boolean));
  };
  const begin = () => {
    if (choice.against === choice.x) choice.against = 'muscles';
    choice.rest = Object.fromEntries(axes.filter((axis) => axis !== choice.x && axis !== choice.against).map((axis) => [axis, choice.rest[axis] ?? String(distinct(jobs.values(axis))[0])]));
    drawChoice();
    drawLoads();
  };

  // ---- the table of jobs --------------------------------------------------------------------------------------------------------

  const PAGE = 50;
  const SHOWN = ['status', 'iterations', 'objective', 'effort', 'tracking_rms_m', 'tracking_rms_deg', 'max_activation', 'n_distinct_optima', 'solve_s', 'wall_s'].filter((name) => jobs.has(name));
  const RANKS = ['deficiency_a', 'deficiency_aj', 'unique', 'loads_unique'].filter((name) => regularity.has(name));
  const value = (row, name) => (RANKS.includes(name) ? (of.regularity.get(jobs.at('job_id', row)) ?? []).map((r) => regularity.at(name, r))[0] ?? null : jobs.at(name, row));
  const shownColumns = ['index', ...report.axes.filter((axis) => jobs.has(axis)), ...SHOWN, ...RANKS];
  const view = { sort: 'index', down: false, filter: '', page: 0, job: null };
  const sortedJobs = () => {
    const words = view.filter.toLowerCase().split(/\s+/).filter(Boolean);
    const rows = Array.from({ length: jobs.rows }, (_, row) => row).filter((row) => {
      if (!words.length) return true;
      const text = [jobs.at('job_id', row), ...shownColumns.map((name) => exact(value(row, name)))].join(' ').toLowerCase();
      return words.every((word) => text.includes(word));
    });
    const sign = view.down ? -1 : 1;
    const order = (a, b) => (a === b ? 0 : a === null ? 1 : b === null ? -1 : sign * (a < b ? -1 : 1));
    return rows.sort((a, b) => order(value(a, view.sort), value(b, view.sort)) || a - b);
  };
  const drawJobs = () => {
    const rows = sortedJobs();
    const pages = Math.max(1, Math.ceil(rows.length / PAGE));
    view.page = Math.min(view.page, pages - 1);
    const head = shownColumns.map((name) => {
      const unit = RANKS.includes(name) ? regularity.unit(name) : report.units[name] ?? jobs.unit(name);
      const mark = view.sort === name ? (view.down ? ' ▼' : ' ▲') : '';
      const sort = () => { view.down = view.sort === name ? !view.down : false; view.sort = name; drawJobs(); byId('jobs').querySelector(`[data-column="${CSS.escape(name)}"]`)?.focus(); };
      return make('th', { scope: 'col', 'aria-sort': view.sort === name ? (view.down ? 'descending' : 'ascending') : 'none' },
        make('button', { type: 'button', 'data-column': name, onclick: sort }, withUnit(name === 'index' ? 'job' : name, unit) + mark));
    });
    const body = rows.slice(view.page * PAGE, (view.page + 1) * PAGE).map((row) => make('tr', { class: jobs.at('job_id', row) === view.job ? 'chosen' : null, 'data-job': jobs.at('job_id', row) },
      make('td', {}, jobLink(row)), ...shownColumns.slice(1).map((name) => cell(value(row, name), name === 'status' && value(row, name) !== 'converged' ? { class: 'bad text' } : {}))));
    byId('jobs').replaceChildren(make('table', {}, make('caption', {}, `${rows.length} job(s), page ${view.page + 1} of ${pages}`), make('thead', {}, make('tr', {}, ...head)), make('tbody', {}, ...body)));
  };
  const drawJobsChoice = () => {
    const filter = make('input', { type: 'search', id: 'filter', placeholder: 'such as: converged 0.2', oninput: () => { view.filter = filter.value; view.page = 0; drawJobs(); } });
    const turn = (by) => () => { view.page = Math.max(0, view.page + by); drawJobs(); };
    byId('jobs-choice').append(make('label', {}, 'filter', filter),
      make('button', { type: 'button', onclick: turn(-1) }, 'previous'), make('button', { type: 'button', onclick: turn(1) }, 'next'));
  };

  // ---- one job ------------------------------------------------------------------------------------------------------------------

  const SIGNALS = [['activation', 'Activation', ''], ['excitation', 'Excitation', ''], ['force_n', 'Muscle force', 'N'], ['fibre_length', 'Fibre length', 'optimal'], ['fibre_velocity', 'Fibre velocity', 'optimal lengths/s'], ['reaction_n', 'Joint reactions', 'N']];
  const drawJob = (id) => {
    const row = jobs.values('job_id').indexOf(id);
    byId('s-job').hidden = row < 0;
    if (row < 0) return;
    view.job = id;
    drawJobs();
    byId('h-job').textContent = `Job ${jobs.at('index', row)}`;
    const home = byId('job');
    const swept = report.axes.filter((axis) => jobs.has(axis)).map((axis) => `${axis} = ${exact(jobs.at(axis, row))}`);
    home.replaceChildren(make('p', {}, `${id}. ${swept.join(', ')}. ${jobs.at('status', row)}${jobs.at('error', row) ? `: ${jobs.at('error', row)}` : ''}${jobs.at('remark', row) ? `. ${jobs.at('remark', row)}` : ''}`));
    const rank = of.regularity.get(id)?.[0];
    if (rank !== undefined && regularity.at('null_space', rank)) home.append(make('p', {}, `Not determined: ${regularity.at('null_space', rank)}.`));
    const columns = Object.keys(muscles.columns).filter((name) => name !== 'job_id');
    const own = of.muscles.get(id) ?? [];
    if (own.length) home.append(grid('Muscles', columns.map((name) => withUnit(name, muscles.unit(name))), own.map((r) => columns.map((name) => muscles.at(name, r)))));
    const plots = byId('job-plots');
    clear(plots);
    drawConvergence(plots, id);
    drawSpectrum(plots, id, rank);
    drawTime(plots, id);
  };
  const drawConvergence = (home, id) => {
    const rows = of.iterations.get(id) ?? [];
    if (!rows.length) return;
    const names = ['stationarity', 'feasibility', 'complementarity', 'step_norm', 'distance_to_solution'];
    const series = names.map((name) => ({ name, points: rows.map((r) => [iterations.at('iteration', r), iterations.at(name, r)]).filter(([, v]) => v > 0) }));
    lines(home, 'Convergence (Figure 6)', { x: 'iteration', y: 'residual', series, log: true });
  };
  const drawSpectrum = (home, id, rank) => {
    const rows = of.spectrum.get(id) ?? [];
    if (!rows.length) return;
    const kinds = distinct(rows.map((r) => spectrum.at('matrix', r)));
    const series = kinds.map((kind) => ({ name: kind, points: rows.filter((r) => spectrum.at('matrix', r) === kind).map((r) => [spectrum.at('index', r), spectrum.at('value', r)]).filter(([, v]) => v > 0) }));
    for (const [kind, column] of [['tolerance of A', 'tolerance_a'], ['tolerance of [Aᵀ Jᵀ]', 'tolerance_aj']]) {
      const cut = rank === undefined ? null : regularity.at(column, rank);
      const all = rows.map((r) => spectrum.at('index', r));
      if (cut > 0) series.push({ name: kind, dashed: true, points: [[Math.min(...all), cut], [Math.max(...all), cut]] });
    }
    lines(home, 'Singular values around the cut', { x: 'number', y: 'singular value', series, log: true });
  };
  const drawTime = (home, id) => {
    const rows = of.trajectories.get(id) ?? [];
    if (!rows.length) {
      home.append(make('p', { class: 'soft' }, 'No functions of time are kept of this job: trajectories = true in the study keeps them.'));
      return;
    }
    const signals = new Map();
    for (const r of rows) {
      const signal = trajectories.at('signal', r);
      const name = trajectories.at('name', r);
      if (!signals.has(signal)) signals.set(signal, new Map());
      if (!signals.get(signal).has(name)) signals.get(signal).set(name, []);
      signals.get(signal).get(name).push([trajectories.at('time_s', r), trajectories.at('value', r)]);
    }
    const all = (signal) => [...(signals.get(signal) ?? new Map())].map(([name, points]) => ({ name, points }));
    for (const [signal, title, unit] of SIGNALS) if (signals.has(signal)) lines(home, title, { x: 'time, s', y: withUnit(title.toLowerCase(), unit || '1'), series: all(signal), symbols: false });
    const beside = (title, found, measured, unit) => {
      if (!signals.has(found) || !signals.has(measured)) return;
      const solved = all(found);
      const series = [...solved, ...all(measured).filter((one) => solved.some(({ name }) => name === one.name)).map((one) => ({ ...one, name: `${one.name}, measured`, dashed: true, style: solved.findIndex(({ name }) => name === one.name) }))];
      lines(home, title, { x: 'time, s', y: unit, series, symbols: false });
    };
    beside('Joint coordinates and measurement', 'joint_coordinate', 'measured_joint_coordinate', 'rad or m');
    beside('Body coordinates and measurement', 'coordinate', 'measured', 'm, rad or Euler parameter');
    drawBounds(home, signals.get('bound_active'));
    drawFigure(home, signals.get('path_point_m'));
  };
  // Which bounds are active when: bound × time.
  const drawBounds = (home, bounds) => {
    if (!bounds) return;
    const names = [...bounds.keys()].sort().reverse();
    const times = distinct(names.flatMap((name) => bounds.get(name).map(([t]) => t)));
    const cells = names.flatMap((name, y) => bounds.get(name).filter(([, v]) => v > 0).map(([t]) => [times.indexOf(t), y, 1]));
    const box = plot(home, 'Active bounds', () => ({
      grid: { left: 150, right: 14, top: 10, bottom: 44 },
      xAxis: { type: 'category', data: times.map(short), name: 'time, s' }, yAxis: { type: 'category', data: names, axisLabel: { color: look().soft, fontSize: 10, width: 140, overflow: 'truncate' } },
      legend: { show: false }, visualMap: { show: false, min: 0, max: 1, inRange: { color: [COLOURS[0], COLOURS[0]] } },
      tooltip: { confine: true, formatter: (p) => `${names[p.value[1]]}<br>active at ${exact(times[p.value[0]])} s` },
      series: [{ type: 'heatmap', name: 'active', data: cells, itemStyle: { borderColor: look().paper, borderWidth: 1 } }],
    }), `Active bounds over time: ${cells.length} active of ${names.length * times.length}`);
    box.style.height = `${Math.max(12, 1.1 * names.length + 6)}rem`;
    drawn.get(box).chart.resize();
  };
  // Muscles by their path points in the x–y plane, every 0.1 s or so (Figure 5).
  const drawFigure = (home, points) => {
    if (!points) return;
    const muscle = new Map();
    for (const [name, values] of points) {
      const [, who, k, axis] = name.match(/^(.*)\.(\d+)\.([xyz])$/) ?? [];
      if (!who) continue;
      if (!muscle.has(who)) muscle.set(who, []);
      (muscle.get(who)[k] ??= {})[axis] = values;
    }
    const times = distinct([...points.values()][0].map(([t]) => t));
    const step = Math.max(1, Math.round(0.1 / ((times[times.length - 1] - times[0]) / Math.max(1, times.length - 1))));
    const kept = times.map((_, k) => k).filter((k) => k % step === 0);
    const names = [...muscle.keys()];
    plot(home, 'Muscles in the x–y plane every 0.1 s (Figure 5)', () => ({
      grid: { left: 64, right: 14, top: 40, bottom: 44 },
      xAxis: { type: 'value', name: 'x, m', scale: true }, yAxis: { type: 'value', name: 'y, m', scale: true },
      tooltip: { confine: true, formatter: (p) => `${p.seriesName}<br>${exact(p.value[2])} s<br>x: ${exact(p.value[0])}<br>y: ${exact(p.value[1])}` },
      series: kept.flatMap((k, order) => names.map((name, m) => ({
        name, type: 'line', symbolSize: 3, lineStyle: { width: 1.2, opacity: 0.25 + (0.75 * (order + 1)) / kept.length }, itemStyle: { color: COLOURS[m % COLOURS.length] },
        data: muscle.get(name).filter((p) => p.x && p.y && p.x[k] && p.y[k]).map((p) => [p.x[k][1], p.y[k][1], times[k]]),
      }))),
    }), `Paths of ${names.length} muscle(s) in the x–y plane at ${kept.length} instants`);
  };

  // ---- all of it ----------------------------------------------------------------------------------------------------------------

  for (const curve of report.curves) lines(byId('curves'), `${curve.title} (${curve.figure})`, { x: curve.x, y: curve.y, series: [{ name: curve.title, points: curve.points }], symbols: false });
  byId('footer').textContent = `Made by sinew ${report.sinew.version} from the tables of the folder. Hover over a number or a point for all of its digits. Charts: Apache ECharts (Apache License 2.0).`;
  byId('wait').remove();
  byId('main').hidden = false;
  if (numberAxes.length && muscleNames.length) { byId('s-loads').hidden = false; begin(); }
  const fromLink = () => { const id = new URLSearchParams(location.hash.slice(1)).get('job'); if (id) { drawJob(id); byId('s-job').scrollIntoView(); } };
  if (jobs.rows) {
    byId('s-jobs').hidden = false;
    drawJobsChoice();
    drawJobs();
    drawJob(jobs.at('job_id', 0));
    fromLink();
  }
  window.addEventListener('hashchange', fromLink);
  drawn.forEach(({ chart }) => chart.resize());
  window.sinew = { report, tables, drawn, ready: true };
})().catch((error) => {
  const wait = document.getElementById('wait');
  if (wait) wait.textContent = `The page cannot be drawn: ${error.message}`;
  console.error(error);
});
