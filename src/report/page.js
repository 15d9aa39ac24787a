'use strict';
// The report page: unpacks the embedded tables, and shows them and their figures (figures.js).
(async () => {
  const byId = (id) => document.getElementById(id);
  const packed = Uint8Array.from(atob(byId('data').textContent.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'));
  const report = JSON.parse(await new Response(stream).text());
  const figures = sinewFigures(report);
  const { now, jobs, regularity, axes, counted, distinct, exact, short, withUnit, axisName, slug } = figures;
  const dark = window.matchMedia('(prefers-color-scheme: dark)');

  // ---- page elements ------------------------------------------------------------------------------------------------------------

  const make = (tag, attributes = {}, ...children) => {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) {
      if (name.startsWith('on')) element.addEventListener(name.slice(2), value);
      else if (value !== null && value !== undefined) element.setAttribute(name, value);
    }
    element.append(...children.filter((child) => child !== null && child !== undefined));
    return element;
  };
  const cell = (value, attributes = {}) =>
    make('td', { title: typeof value === 'number' ? exact(value) : null, class: typeof value === 'string' ? 'text' : null, ...attributes }, short(value));
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

  // ---- figures ------------------------------------------------------------------------------------------------------------------

  const drawn = new Map();
  const look = (box) => {
    const style = getComputedStyle(document.documentElement);
    const colours = Object.fromEntries(['ink', 'soft', 'line', 'paper'].map((name) => [name, style.getPropertyValue(`--${name}`).trim()]));
    return { ...colours, width: box.clientWidth, height: box.clientHeight };
  };
  // Replaces the contents of `home` by figures, which are redrawn when the theme or the width changes.
  const show = (home, all, small = false) => {
    for (const box of home.querySelectorAll('.plot')) { drawn.get(box)?.chart.dispose(); drawn.delete(box); }
    home.replaceChildren();
    home.classList.toggle('small', small);
    for (const figure of all) {
      const box = make('div', { class: 'plot', role: 'img', style: figure.rem ? `height: ${figure.rem}rem` : null });
      const save = make('button', { type: 'button', onclick: () => saveSvg(box, figure), 'aria-label': `Save “${figure.title}” as SVG` }, 'SVG');
      home.append(make('figure', { 'data-figure': figure.name }, make('figcaption', {}, make('h3', {}, figure.title), save), box));
      const chart = echarts.init(box, null, { renderer: 'svg' });
      const draw = () => {
        chart.setOption(figures.chartOption(figure, look(box)), true);
        // Replaces the label that ECharts generates.
        box.setAttribute('aria-label', figure.alt);
      };
      drawn.set(box, { chart, draw });
      draw();
    }
  };
  const saveSvg = (box, figure) => {
    const svg = drawn.get(box).chart.renderToSVGString();
    const link = make('a', { href: URL.createObjectURL(new Blob([svg], { type: 'image/svg+xml' })), download: `${slug(report.study.name)}-${figure.name}.svg` });
    link.click();
    URL.revokeObjectURL(link.href);
  };
  const redraw = () => drawn.forEach(({ chart, draw }) => { chart.resize(); draw(); });
  dark.addEventListener('change', redraw);
  window.addEventListener('resize', redraw);
  // Gives the page the text width of an A4 sheet while it is printed.
  const paper = (width) => () => { document.body.style.width = width; redraw(); };
  window.addEventListener('beforeprint', paper('18cm'));
  window.addEventListener('afterprint', paper(''));

  // ---- study and run ------------------------------------------------------------------------------------------------------------

  byId('description').textContent = report.study.description;
  const entry = (name, value) => make('dl', {}, make('dt', {}, name), make('dd', {}, value));
  const { study } = report;
  byId('asked').append(
    entry('Study', `${study.file} (${study.hash})`),
    entry('Model', `${study.model.file} (${study.model.hash})`),
    entry('Motion', `${study.motion.file} (${study.motion.hash.slice(0, 16)})`),
    entry('Solver', `sinew ${report.sinew.version}, ${report.sinew.solver}`),
    entry('Host', [report.host.name, report.host.os, report.host.arch, report.host.threads ? counted(report.host.threads, 'thread') : null].filter(Boolean).join(', ')),
    ...report.axes.map((axis) => {
      const values = jobs.has(axis) ? distinct(jobs.values(axis)) : [];
      const shown = values.length > 12 ? `${values.length} values, ${short(values[0])} to ${short(values[values.length - 1])}` : values.map(short).join(', ');
      return entry(`Swept: ${withUnit(axis, report.units[axis])}`, shown || 'no finished jobs');
    }),
    entry('Fixed', Object.entries(report.base).filter(([, value]) => value !== null && !(Array.isArray(value) && !value.length)).map(([name, value]) => `${name} = ${typeof value === 'object' ? JSON.stringify(value) : value}`).join('; ')),
  );
  const statuses = jobs.by('status');
  const went = byId('went');
  const total = (name) => jobs.values(name).reduce((sum, value) => sum + (value ?? 0), 0);
  const counts = [...statuses].sort((a, b) => b[1].length - a[1].length).map(([status, rows]) => `${rows.length} ${status}`);
  went.append(make('p', { id: 'counts' }, jobs.rows
    ? `${jobs.rows} of ${report.planned} jobs finished: ${counts.join(', ')}. Total time ${short(total('wall_s'))} s.`
    : `None of ${report.planned} jobs have finished, or their tables do not exist yet (sinew merge creates them): there is nothing to draw.`));
  const doubtful = jobs.has('warnings') ? jobs.values('warnings').map((codes) => (codes ? codes.split(', ') : [])) : [];
  if (doubtful.some((codes) => codes.length)) {
    const kinds = report.warnings.map((kind) => ({ ...kind, count: doubtful.filter((codes) => codes.includes(kind.code)).length })).filter(({ count }) => count);
    went.append(make('p', { id: 'warnings', class: 'bad' }, `${counted(doubtful.filter((codes) => codes.length).length, 'job')} with warnings: a converged job is not necessarily plausible.`),
      make('ul', {}, ...kinds.map(({ code, count, limit, remedy }) => make('li', {}, make('b', {}, code), ` (${count}): ${limit}. ${remedy[0].toUpperCase()}${remedy.slice(1)}.`))));
  }
  for (const note of report.notes) went.append(make('p', { class: 'soft' }, note));
  const failures = [];
  for (let row = 0; row < jobs.rows; row++) if (jobs.at('error', row)) failures.push([jobLink(row), jobs.at('status', row), jobs.at('error', row)]);
  if (failures.length) went.append(grid(`${counted(failures.length, 'failed job')}${failures.length > 50 ? ', the first 50' : ''}`, ['job', 'status', 'reason'], failures.slice(0, 50).map(([link, ...rest]) => [make('td', {}, link), ...rest])));
  if (regularity.has('loads_unique')) {
    const verdicts = regularity.values('loads_unique').filter((verdict) => verdict !== null);
    went.append(make('p', {}, `Muscle loads are unique in ${verdicts.filter(Boolean).length} of ${counted(verdicts.length, 'converged job')} with a verdict. Each verdict applies to the optimum found; there may be others.`));
  }

  function jobLink(row) { return make('a', { href: `#job=${jobs.at('job_id', row)}` }, exact(jobs.at('index', row))); }

  // ---- drift against a baseline -------------------------------------------------------------------------------------------------

  if (report.beside) {
    byId('s-drift').hidden = false;
    const { counts: changed, changes, gone, folder } = report.beside;
    byId('drift').append(make('p', {}, `Compared with ${folder}: ${Object.entries(changed).map(([kind, n]) => `${n} ${kind}`).join(', ') || 'no jobs in common'}.`));
    for (const name of gone) byId('drift').append(make('p', { class: 'bad' }, `${name} is only in the baseline.`));
    if (changes.length) {
      byId('drift').append(grid(`${counted(changes.length, 'changed cell')}`, ['job', 'table', 'row', 'column', 'baseline', 'now', 'tolerance'],
        changes.slice(0, 500).map((c) => [make('td', {}, make('a', { href: `#job=${c.job_id}` }, exact(c.job))), c.table, c.row, c.column, exact(c.baseline), exact(c.found), c.tolerance])));
    }
  }

  // ---- Table 1 ------------------------------------------------------------------------------------------------------------------

  const BOUNDS = [['activation', 'a ≥ 0'], ['excitation', 'u ≥ 0'], ['both', 'u, a ≥ 0']];
  const isTable1 = ['load_sharing_grid', 'bounds'].every((axis) => report.axes.includes(axis)) && regularity.rows > 0;
  if (isTable1) {
    byId('s-ranks').hidden = false;
    byId('ranks').append(make('p', {}, '0 means full rank. The numbers in brackets are the thesis’ own, for its arm model with h = 0.2.'));
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
            const [at] = now.of('regularity', row);
            const found = at === undefined ? null : regularity.at(column, at);
            const text = found === null ? jobs.at('status', row) : `${-found || 0} (${-expected || 0})`;
            return make('td', { class: found === expected ? null : 'bad', title: `${column} of job ${jobs.at('index', row)}: ${exact(found)}` }, make('a', { href: `#job=${jobs.at('job_id', row)}` }, text));
          })]);
        }
      }
      byId('ranks').append(grid(key || null, ['', ...BOUNDS.map(([, name]) => name)], rows));
    }
  }

  // ---- loads against the axes ---------------------------------------------------------------------------------------------------

  let choice = figures.ofLoads();
  const choose = (change) => {
    choice = figures.ofLoads({ ...choice, ...change });
    const byAxis = (axis) => [axis, axisName(axis)];
    byId('loads-choice').replaceChildren(...[
      select('measure', figures.MEASURES, choice.measure, (measure) => choose({ measure })),
      select('over', axes.map(byAxis), choice.x, (x) => choose({ x, rest: {} })),
      axes.length > 1 ? select('as', [['lines', jobs.isNumber(choice.x) ? 'lines' : 'bars'], ...axes.filter((axis) => axis !== choice.x).map((axis) => [axis, `map against ${axis}`])], choice.against, (against) => choose({ against, rest: {} })) : null,
      ...Object.entries(choice.rest).map(([axis, value]) => select(axisName(axis), distinct(jobs.values(axis)).map((one) => [String(one), short(one)]), value, (one) => choose({ rest: { ...choice.rest, [axis]: one } }))),
    ].filter(Boolean));
    const all = figures.loads(choice);
    show(byId('loads'), all, all.length > 4);
  };

  // ---- job table ----------------------------------------------------------------------------------------------------------------

  const PAGE = 50;
  const SHOWN = ['status', 'iterations', 'objective', 'effort', 'tracking_rms_m', 'tracking_rms_deg', 'max_activation', 'n_distinct_optima', 'solve_s', 'wall_s', 'warnings'].filter((name) => jobs.has(name));
  const RANKS = ['deficiency_a', 'deficiency_aj', 'answer_unique', 'loads_unique'].filter((name) => regularity.has(name));
  const value = (row, name) => (RANKS.includes(name) ? now.of('regularity', row).map((r) => regularity.at(name, r))[0] ?? null : jobs.at(name, row));
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
    byId('jobs').replaceChildren(make('table', {}, make('caption', {}, `${counted(rows.length, 'job')}, page ${view.page + 1} of ${pages}`), make('thead', {}, make('tr', {}, ...head)), make('tbody', {}, ...body)));
  };
  const drawJobsChoice = () => {
    const filter = make('input', { type: 'search', id: 'filter', placeholder: 'e.g. converged 0.2', oninput: () => { view.filter = filter.value; view.page = 0; drawJobs(); } });
    const turn = (by) => () => { view.page = Math.max(0, view.page + by); drawJobs(); };
    byId('jobs-choice').append(make('label', {}, 'filter', filter),
      make('button', { type: 'button', onclick: turn(-1) }, 'previous'), make('button', { type: 'button', onclick: turn(1) }, 'next'));
  };

  // ---- one job ------------------------------------------------------------------------------------------------------------------

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
    const [rank] = now.of('regularity', row);
    if (rank !== undefined && regularity.at('null_space', rank)) home.append(make('p', {}, `Not determined: ${regularity.at('null_space', rank)}.`));
    for (const [name, caption] of [['muscles', 'Muscles'], ['optima', 'Optima found'], ['sensitivities', 'Sensitivities of mean forces']]) {
      const columns = Object.keys(now[name].columns).filter((column) => column !== 'job_id');
      const own = now.of(name, row);
      const folded = (table) => (name === 'muscles' ? table : make('details', {}, make('summary', {}, `${caption} (${own.length})`), table));
      if (own.length) home.append(folded(grid(name === 'muscles' ? caption : null, columns.map((column) => withUnit(column, now[name].unit(column))), own.map((r) => columns.map((column) => now[name].at(column, r))))));
    }
    const all = figures.ofJob(row);
    show(byId('job-plots'), all);
    const kept = now.of('trajectories', row).length > 0;
    if (!kept) byId('job-plots').append(make('p', { class: 'soft' }, 'No functions of time were stored for this job. Set trajectories = true in the study to store them.'));
  };

  // ---- assembly -----------------------------------------------------------------------------------------------------------------

  byId('footer').textContent = `Made by sinew ${report.sinew.version} from the tables of the results folder. Hover over a number or a point to see all its digits. Charts: Apache ECharts (Apache License 2.0).`;
  byId('wait').remove();
  byId('main').hidden = false;
  show(byId('curves'), figures.curves(), true);
  if (axes.length && figures.muscleNames.length) { byId('s-loads').hidden = false; choose({}); }
  const fromLink = () => { const id = new URLSearchParams(location.hash.slice(1)).get('job'); if (id) { drawJob(id); byId('s-job').scrollIntoView(); } };
  if (jobs.rows) {
    byId('s-jobs').hidden = false;
    drawJobsChoice();
    drawJobs();
    drawJob(jobs.at('job_id', figures.firstJob()));
    fromLink();
  }
  window.addEventListener('hashchange', fromLink);
  window.sinew = { report, drawn, ready: true };
})().catch((error) => {
  const wait = document.getElementById('wait');
  if (wait) wait.textContent = `Cannot draw the page: ${error.message}`;
  console.error(error);
});
