'use strict';
// Defines the figures of a report from its tables. page.js shows them on the page; `sinew report --svg` writes them to files.
//
// A figure has a `name` (of its file), a `title`, an `alt` text for screen readers, `option(look)`, which returns the ECharts options, and an
// optional height `rem`. A look has the colours `ink`, `soft`, `line` and `paper`, `width` and `height` in pixels, and `still`, set if the
// figure is not interactive. All values come straight from a table; only the rows are chosen here.
const sinewFigures = (report) => {
  // Okabe and Ito's palette, which colour-blind readers can tell apart. When the colours run out, line styles change.
  const COLOURS = ['#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#8c6d00', '#7f7f7f'];
  const DASHES = ['solid', 'dashed', 'dotted'];
  const SYMBOLS = ['circle', 'rect', 'triangle', 'diamond'];
  // Title of the time axis, which is always linear.
  const TIME = 'time, s';
  // If there are more muscles than this, each gets its own figure.
  const TOGETHER = 8;

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

  // The tables of a results folder, with the rows of each job.
  class Results {
    constructor(tables) {
      for (const name of ['jobs', 'regularity', 'muscles', 'ratios', 'iterations', 'spectrum', 'optima', 'sensitivities', 'trajectories']) {
        this[name] = new Table(tables[name]);
      }
      this.rowsOf = {};
    }
    // Rows of a table that belong to a job, given by its row in `jobs`.
    of(table, job) {
      this.rowsOf[table] ??= this[table].has('job_id') ? this[table].by('job_id') : new Map();
      return this.rowsOf[table].get(this.jobs.at('job_id', job)) ?? [];
    }
    muscle(job, name, column) {
      this.muscleRows ??= new Map(Array.from({ length: this.muscles.rows }, (_, row) => [`${this.muscles.at('job_id', row)}/${this.muscles.at('muscle', row)}`, row]));
      const row = this.muscleRows.get(`${this.jobs.at('job_id', job)}/${name}`);
      return row === undefined ? null : this.muscles.at(column, row);
    }
    ratio(job, name) {
      const row = this.of('ratios', job).find((r) => ratioName(this, r) === name);
      return row === undefined ? null : this.ratios.at('value', row);
    }
    // Converged jobs with the axis values `rest` (as texts).
    converged(rest) {
      const rows = [];
      for (let row = 0; row < this.jobs.rows; row++) {
        if (this.jobs.at('status', row) === 'converged' && Object.entries(rest).every(([axis, value]) => String(this.jobs.at(axis, row)) === value)) rows.push(row);
      }
      return rows;
    }
    // [[x, value, job]] of converged jobs, sorted by x.
    along(x, rest, value) {
      if (!this.jobs.has(x)) return [];
      const points = this.converged(rest).map((job) => [this.jobs.at(x, job), value(this, job), job]).filter(([a, b]) => a !== null && b !== null);
      return this.jobs.isNumber(x) ? points.sort((a, b) => compare(a[0], b[0])) : points;
    }
  }
  const ratioName = (results, row) => `${results.ratios.at('ratio', row)} (${results.ratios.at('measure', row)})`;
  const compare = (a, b) => a - b;
  // Numbers in ascending order, texts in the order of the study.
  const counted = (count, noun) => `${count} ${noun}${count === 1 ? '' : 's'}`;
  const distinct = (values) => { const all = [...new Set(values)]; return all.every((value) => typeof value === 'number') ? all.sort(compare) : all; };

  const now = new Results(report.tables);
  const old = report.beside ? new Results(report.beside.tables) : null;
  const { jobs, regularity, muscles } = now;
  const axes = report.axes.filter((axis) => jobs.has(axis) && distinct(jobs.values(axis)).length > 1);
  const muscleNames = muscles.rows ? [...new Set(muscles.values('muscle'))] : [];
  const MEASURES = [['mean_force_n', 'mean force, N'], ['peak_force_n', 'peak force, N'], ['mean_activation', 'mean activation'], ['peak_activation', 'peak activation'], ['impulse_n_s', 'impulse, N s']].filter(([name]) => muscles.has(name));

  // ---- texts --------------------------------------------------------------------------------------------------------------------

  const exact = (value) => (value === null || value === undefined ? '–' : String(value));
  // Six digits. The title of a cell and the tooltip of a point show all digits.
  const short = (value) => (typeof value === 'number' && !Number.isInteger(value) ? String(Number(value.toPrecision(6))) : exact(value));
  const withUnit = (name, unit) => (unit && unit !== '1' ? `${name}, ${unit}` : name);
  const axisName = (axis) => withUnit(axis, report.units[axis]);
  // A part of a file name, which has a limited length.
  const slug = (text) => text.replace(/[^\w.-]+/g, '_').replace(/^_+|_+$/g, '').slice(0, 70);

  // ---- kinds of figure ----------------------------------------------------------------------------------------------------------

  // Lines with more than POINTS points have no symbols. A range of x wider than the factor WIDE gets a logarithmic axis.
  const [POINTS, WIDE] = [100, 50];
  const LEGEND = 170;
  const GRID = { left: 72, right: 14, top: 40, bottom: 44 };
  // The complete ECharts options: those common to all figures, in the colours of the theme, and the figure's own.
  const chartOption = (figure, look) => {
    const { ink, soft, line, paper } = look;
    const axis = { axisLine: { onZero: false, lineStyle: { color: soft } }, axisLabel: { color: soft, hideOverlap: true }, nameTextStyle: { color: soft }, splitLine: { lineStyle: { color: line } } };
    const made = figure.option(look);
    for (const side of ['xAxis', 'yAxis']) made[side] = { ...axis, nameLocation: 'middle', nameGap: side === 'xAxis' ? 26 : 54, ...made[side], axisLabel: { ...axis.axisLabel, ...made[side].axisLabel } };
    // A still figure cannot scroll its legend, so a long legend goes to the side.
    const names = new Set(made.series.map((one) => one.name));
    const aside = look.still && names.size > 4 && made.legend?.show !== false;
    return {
      color: COLOURS, animation: false, aria: { enabled: true }, textStyle: { color: ink, fontFamily: 'system-ui, sans-serif' },
      ...made,
      grid: { ...GRID, ...made.grid, ...(aside ? { right: LEGEND } : {}) },
      legend: { type: 'scroll', top: 0, textStyle: { color: ink }, pageTextStyle: { color: ink }, pageIconColor: ink, ...(aside ? { type: 'plain', orient: 'vertical', left: look.width - LEGEND + 8, top: 30, itemGap: 5, textStyle: { color: ink, width: LEGEND - 50, overflow: 'truncate' } } : {}), ...made.legend },
      tooltip: { trigger: 'item', confine: true, backgroundColor: paper, borderColor: line, textStyle: { color: ink, fontSize: 12 }, ...made.tooltip },
    };
  };
  // Escapes names in tooltips, which are HTML.
  const tip = (parts, ...values) => String.raw({ raw: parts }, ...values.map((value) => String(value).replace(/[&<>"']/g, (one) => `&#${one.charCodeAt(0)};`)));
  const styled = (k) => ({ lineStyle: { type: DASHES[Math.floor(k / COLOURS.length) % DASHES.length], width: 2 }, symbol: SYMBOLS[k % SYMBOLS.length], symbolSize: 6, itemStyle: { color: COLOURS[k % COLOURS.length] } });
  const named = (series) => `${counted(series.length, 'line')}: ${series.map((one) => one.name).join(', ')}`;
  // Lines [{name, points: [[x, y], …], style, dashed}] over a common axis. With `log`, y is plotted as its decimal exponent, at least −16.
  const lines = (name, title, { x, y, series, log, symbols = true, extra = [] }) => {
    const [least, most] = series.flatMap((one) => one.points).reduce(([low, high], [a]) => [Math.min(low, a), Math.max(high, a)], [Infinity, -Infinity]);
    const decades = x !== TIME && least > 0 && most >= WIDE * least;
    symbols &&= series.every((one) => one.points.length <= POINTS);
    const value = (point) => exact(log ? point.value[2] : point.value[1]);
    return {
      name, title, alt: `${title}: ${y} over ${x}, ${named(series)}`,
      option: () => ({
        xAxis: { type: decades ? 'log' : 'value', name: x, scale: true },
        yAxis: { type: 'value', name: y, scale: true, axisLabel: log ? { formatter: (v) => `1e${v}` } : {} },
        // The tooltip of a symbol shows its own value; without symbols it shows the values of all lines at that x.
        tooltip: symbols
          ? { formatter: (point) => tip`${point.seriesName}<br>${x}: ${exact(point.value[0])}<br>${y}: ${value(point)}` }
          : { trigger: 'axis', formatter: (points) => [tip`${x}: ${exact(points[0].value[0])}`, ...points.map((point) => point.marker + tip`${point.seriesName}: ${value(point)}`)].join('<br>') },
        series: [...extra, ...series.map((one, k) => {
          const style = styled(one.style ?? k);
          if (one.dashed) style.lineStyle = { ...style.lineStyle, type: 'dashed', opacity: 0.7 };
          const points = log ? one.points.filter(([, v]) => v > 0).map(([a, v]) => [a, Math.log10(Math.max(v, 1e-16)), v]) : one.points;
          return { name: one.name, type: 'line', data: points, showSymbol: symbols, ...style };
        })],
      }),
    };
  };
  // Bars [{name, points: [[category, y], …], style, dashed, ends: [[category, low, high], …]}] over an axis of categories.
  const bars = (name, title, { x, y, categories, series }) => ({
    name, title, alt: `${title}: ${y} for each ${x}, ${counted(series.length, 'bar')} each: ${series.map((one) => one.name).join(', ')}`,
    option: ({ ink }) => {
      const gaps = { barGap: '10%', barCategoryGap: '25%' };
      const place = (category) => categories.indexOf(category);
      const ends = series.flatMap((one, bar) => (one.ends ?? []).length ? [{
        name: `${one.name}, not unique`, type: 'custom', z: 5, data: one.ends.map(([category, low, high]) => [place(category), low, high]), itemStyle: { color: ink },
        tooltip: { formatter: (point) => tip`${one.name}, not unique<br>${categories[point.value[0]]}<br>${y}: ${exact(point.value[1])} to ${exact(point.value[2])}` },
        renderItem: (_, api) => {
          const { offsetCenter } = api.barLayout({ count: series.length, ...gaps })[bar];
          const [at, low] = api.coord([api.value(0), api.value(1)]);
          const [, high] = api.coord([api.value(0), api.value(2)]);
          return { type: 'line', shape: { x1: at + offsetCenter, x2: at + offsetCenter, y1: low, y2: high }, style: { stroke: ink, lineWidth: 2 } };
        },
      }] : []);
      return {
        xAxis: { type: 'category', data: categories.map(short), name: x }, yAxis: { type: 'value', name: y },
        legend: { data: series.map((one) => one.name) },
        tooltip: { formatter: (point) => tip`${point.seriesName}<br>${x}: ${exact(categories[point.value[0]])}<br>${y}: ${exact(point.value[1])}` },
        series: [...series.map((one, k) => ({
          name: one.name, type: 'bar', ...gaps, data: one.points.map(([category, v]) => [place(category), v]),
          itemStyle: { color: COLOURS[(one.style ?? k) % COLOURS.length], opacity: one.dashed ? 0.5 : 1 },
        })), ...ends],
      };
    },
  });

  // ---- loads against the swept axes ---------------------------------------------------------------------------------------------

  // Completes a choice {measure, x, against, rest}: `against` is 'lines', or the second axis of a map; `rest` has a value (as a text) of every
  // other axis.
  const ofLoads = (given = {}) => {
    const choice = { measure: MEASURES[0]?.[0], x: axes.filter((axis) => jobs.isNumber(axis)).pop() ?? axes[axes.length - 1], against: 'lines', ...given };
    if (choice.against === choice.x) choice.against = 'lines';
    const others = axes.filter((axis) => axis !== choice.x && axis !== choice.against);
    // By default the combination of the other axes' values that has the most converged jobs; the first one if several do.
    const key = (row) => JSON.stringify(others.map((axis) => String(jobs.at(axis, row))));
    const wanted = (row) => others.every((axis) => given.rest?.[axis] === undefined || given.rest[axis] === String(jobs.at(axis, row)));
    const lengths = new Map();
    for (const row of now.converged({})) if (wanted(row)) lengths.set(key(row), (lengths.get(key(row)) ?? 0) + 1);
    const longest = [...lengths].reduce((best, one) => (one[1] > best[1] ? one : best), [null, 0])[0];
    const values = longest ? JSON.parse(longest) : others.map((axis) => given.rest?.[axis] ?? String(distinct(jobs.values(axis))[0]));
    choice.rest = Object.fromEntries(others.map((axis, k) => [axis, values[k]]));
    return choice;
  };
  const loads = ({ measure, x, against, rest }) => {
    const unit = MEASURES.find(([name]) => name === measure)[1];
    const file = (what) => `${measure}-over-${slug(x)}-${slug(what)}`;
    if (against !== 'lines') return muscleNames.flatMap((name) => map(`${measure}-over-${slug(x)}-and-${slug(against)}-${slug(name)}`, name, { x, y: against, rest, value: (results, job) => results.muscle(job, name, measure), unit }));
    const number = jobs.isNumber(x);
    const categories = number ? [] : distinct(jobs.values(x));
    const figure = (name, title, y, series, extra = []) => (number ? lines(name, title, { x: axisName(x), y, series, extra }) : bars(name, title, { x: axisName(x), y, categories, series }));
    const both = (names, value) => [
      ...names.map((name) => ({ name, points: now.along(x, rest, value(name)) })),
      ...(old ? names.map((name, k) => ({ name: `${name}, baseline`, style: k, dashed: true, points: old.along(x, rest, value(name)) })) : []),
    ].filter((one) => one.points.length);
    const groups = muscleNames.length > TOGETHER ? muscleNames.map((name) => [name]) : [muscleNames];
    const ratios = distinct(Array.from({ length: now.ratios.rows }, (_, row) => ratioName(now, row)));
    // A muscle without values in these jobs gets no figure.
    return [
      ...groups.flatMap((group) => {
        const series = both(group, (name) => (results, job) => results.muscle(job, name, measure));
        const ends = measure === 'mean_activation' ? group.map((name) => [name, notUnique(name, x, rest)]).filter(([, points]) => points.length) : [];
        if (!number) for (const [name, points] of ends) { const one = series.find((s) => s.name === name); if (one) one.ends = points; }
        const title = group.length === 1 ? group[0] : 'All muscles';
        return series.length === 0 ? [] : figure(file(title), title, unit, series, number ? ends.flatMap(([name, points]) => band(name, points, group.indexOf(name))) : []);
      }),
      ...ratios.map((name) => figure(`ratio-over-${slug(x)}-${slug(name)}`, `Ratio: ${name}`, 'ratio', both([name], (ratio) => (results, job) => results.ratio(job, ratio)))),
    ];
  };
  // [[x, low, high]]: the interval of a mean activation to first order; empty if it is unique.
  const notUnique = (name, x, rest) => {
    const ends = now.along(x, rest, (results, job) => results.muscle(job, name, 'mean_activation_low')).map(([a, low, job]) => [a, low, now.muscle(job, name, 'mean_activation_high')]).filter((e) => e[2] !== null);
    return ends.some(([, low, high]) => high - low > 1e-9) ? ends : [];
  };
  const band = (name, ends, k) => {
    const common = { name: `${name}, not unique`, type: 'line', stack: `band ${name}`, symbol: 'none', lineStyle: { opacity: 0 }, silent: true, tooltip: { show: false } };
    return [
      { ...common, data: ends.map(([a, low]) => [a, low]) },
      { ...common, data: ends.map(([a, low, high]) => [a, high - low]), areaStyle: { color: COLOURS[k % COLOURS.length], opacity: 0.25 } },
    ];
  };
  const map = (name, title, { x, y, rest, value, unit }) => {
    const points = now.along(x, rest, value);
    const xs = distinct(points.map(([a]) => a));
    const ys = distinct(points.map(([, , job]) => jobs.at(y, job)));
    const cells = points.map(([a, v, job]) => [xs.indexOf(a), ys.indexOf(jobs.at(y, job)), v]);
    const values = cells.map((c) => c[2]);
    return cells.length === 0 ? [] : {
      name, title, alt: `${title}: ${unit} over ${x} and ${y}, ${cells.length} cells`,
      option: ({ ink }) => ({
        grid: { top: 14, bottom: 84 }, legend: { show: false },
        xAxis: { type: 'category', data: xs.map(short), name: axisName(x) }, yAxis: { type: 'category', data: ys.map(short), name: axisName(y) },
        tooltip: { formatter: (p) => tip`${title}<br>${x}: ${exact(xs[p.value[0]])}<br>${y}: ${exact(ys[p.value[1]])}<br>${unit}: ${exact(p.value[2])}` },
        // Cividis, whose lightness rises evenly for every reader.
        visualMap: { min: Math.min(...values), max: Math.max(...values), calculable: true, orient: 'horizontal', left: 'center', bottom: 0, itemHeight: 90, textStyle: { color: ink }, inRange: { color: ['#00224e', '#35456c', '#666970', '#948e77', '#c8b866', '#fee838'] } },
        series: [{ type: 'heatmap', name: title, data: cells }],
      }),
    };
  };

  // ---- one job ------------------------------------------------------------------------------------------------------------------

  const SIGNALS = [['activation', 'Activation', ''], ['excitation', 'Excitation', ''], ['force_n', 'Muscle force', 'N'], ['fibre_length', 'Fibre length', 'optimal'], ['fibre_velocity', 'Fibre velocity', 'optimal lengths/s'], ['reaction_n', 'Joint reactions', 'N']];
  // The first converged job, or the first job if none has converged.
  const firstJob = () => now.converged({})[0] ?? 0;
  const ofJob = (job) => [...convergence(job), ...singularValues(job), ...overTime(job)];
  const convergence = (job) => {
    const { iterations } = now;
    const rows = now.of('iterations', job);
    const names = ['stationarity', 'feasibility', 'complementarity', 'step_norm', 'distance_to_solution'];
    const series = names.map((name) => ({ name, points: rows.map((r) => [iterations.at('iteration', r), iterations.at(name, r)]) }));
    return rows.length ? [lines('convergence', 'Convergence (Figure 6)', { x: 'iteration', y: 'residual', series, log: true })] : [];
  };
  const singularValues = (job) => {
    const { spectrum } = now;
    const rows = now.of('spectrum', job);
    if (!rows.length) return [];
    const kinds = distinct(rows.map((r) => spectrum.at('matrix', r)));
    const series = kinds.map((kind) => ({ name: { a: 'A', aj: '[Aᵀ Jᵀ]' }[kind] ?? kind, points: rows.filter((r) => spectrum.at('matrix', r) === kind).map((r) => [spectrum.at('index', r), spectrum.at('value', r)]) }));
    const [rank] = now.of('regularity', job);
    const all = rows.map((r) => spectrum.at('index', r));
    for (const [kind, column] of [['tolerance of A', 'tolerance_a'], ['tolerance of [Aᵀ Jᵀ]', 'tolerance_aj']]) {
      const cut = rank === undefined ? null : regularity.at(column, rank);
      if (cut > 0) series.push({ name: kind, dashed: true, points: [[Math.min(...all), cut], [Math.max(...all), cut]] });
    }
    return [lines('singular_values', 'Singular values around the cut', { x: 'number', y: 'singular value', series, log: true })];
  };
  // Functions of time: signal → name → [[time, value]].
  const signalsOf = (results, job) => {
    const { trajectories } = results;
    const signals = new Map();
    for (const r of results.of('trajectories', job)) {
      const [signal, name] = [trajectories.at('signal', r), trajectories.at('name', r)];
      if (!signals.has(signal)) signals.set(signal, new Map());
      if (!signals.get(signal).has(name)) signals.get(signal).set(name, []);
      signals.get(signal).get(name).push([trajectories.at('time_s', r), trajectories.at('value', r)]);
    }
    return signals;
  };
  // The baseline's job with the same id, or else with the same value of every axis.
  const oldJob = (job) => {
    const all = Array.from({ length: old.jobs.rows }, (_, row) => row);
    const same = (columns) => all.find((row) => columns.every((name) => exact(old.jobs.at(name, row)) === exact(jobs.at(name, job))));
    return same(['job_id']) ?? (report.axes.length ? same(report.axes) : undefined);
  };
  const overTime = (job) => {
    const signals = signalsOf(now, job);
    const before = old ? oldJob(job) : undefined;
    const oldSignals = before === undefined ? new Map() : signalsOf(old, before);
    const all = (from, signal) => [...(from.get(signal) ?? [])].map(([name, points]) => ({ name, points }));
    // A signal, with others (measured, or from the baseline) dashed in the same colours.
    const withOther = (signal, others) => {
      const solved = all(signals, signal);
      const place = (name) => solved.findIndex((one) => one.name === name);
      return [...solved, ...others.flatMap(([label, found]) => found.filter(({ name }) => place(name) >= 0).map(({ name, points }) => ({ name: `${name}, ${label}`, points, dashed: true, style: place(name) })))];
    };
    const drawn = (signal, title, unit, others = []) => {
      const series = signals.has(signal) ? withOther(signal, [...others, ['baseline', all(oldSignals, signal)]]) : [];
      return series.length ? [lines(signal, title, { x: TIME, y: unit, series, symbols: false })] : [];
    };
    return [
      ...SIGNALS.flatMap(([signal, title, unit]) => drawn(signal, title, withUnit(title.toLowerCase(), unit || '1'))),
      ...drawn('joint_coordinate', 'Joint coordinates and measurement', 'rad or m', [['measured', all(signals, 'measured_joint_coordinate')]]),
      ...drawn('coordinate', 'Unknowns of the motion and measurement', 'm or rad', [['measured', all(signals, 'measured')]]),
      ...activeBounds(signals.get('bound_active')),
      ...stickFigures(signals.get('bone_point_m'), signals.get('path_point_m')),
    ];
  };
  // Active bounds over time: a map of bound × time.
  const activeBounds = (bounds) => {
    if (!bounds) return [];
    const names = [...bounds.keys()].sort().reverse();
    const times = distinct(names.flatMap((name) => bounds.get(name).map(([t]) => t)));
    const place = new Map(times.map((t, k) => [t, k]));
    const cells = names.flatMap((name, y) => bounds.get(name).filter(([, v]) => v > 0).map(([t]) => [place.get(t), y, 1]));
    return [{
      name: 'active_bounds', title: 'Active bounds', alt: `Active bounds over time: ${cells.length} active of ${names.length * times.length}`, rem: Math.max(12, 1.1 * names.length + 6),
      option: ({ soft, paper }) => ({
        grid: { left: 150, top: 10 }, legend: { show: false },
        xAxis: { type: 'category', data: times.map(short), name: 'time, s' }, yAxis: { type: 'category', data: names, axisLabel: { color: soft, fontSize: 10, width: 140, overflow: 'truncate' } },
        visualMap: { show: false, min: 0, max: 1, inRange: { color: [COLOURS[0], COLOURS[0]] } },
        tooltip: { formatter: (p) => tip`${names[p.value[1]]}<br>active at ${exact(times[p.value[0]])} s` },
        series: [{ type: 'heatmap', name: 'active', data: cells, itemStyle: { borderColor: paper, borderWidth: 1 } }],
      }),
    }];
  };
  // Bones and muscles every 0.1 s (Figure 5), from the side, and for a spatial model also from the front. Both axes have the same scale.
  const stickFigures = (bones, muscles) => {
    if (!bones && !muscles) return [];
    // `name.k.axis` → name → [{x, y, z: [[time, m]]}]
    const paths = (points) => {
      const found = new Map();
      for (const [name, values] of points ?? []) {
        const [, who, k, axis] = name.match(/^(.*)\.(\d+)\.([xyz])$/);
        if (!found.has(who)) found.set(who, []);
        (found.get(who)[k] ??= {})[axis] = values;
      }
      return [...found];
    };
    const [ofBones, ofMuscles] = [paths(bones), paths(muscles)];
    const times = [...(bones ?? muscles).values()][0].map(([t]) => t);
    const kept = [];
    for (let k = 0; k < times.length; k++) if (!kept.length || times[k] - times[kept[kept.length - 1]] > 0.1 - 1e-9) kept.push(k);
    const from = (side, across, up) => {
      const has = (p) => p[across] && p[up];
      const all = [...ofBones, ...ofMuscles].flatMap(([, path]) => path.filter(has));
      if (!all.length) return [];
      const range = (axis) => { const v = all.flatMap((p) => kept.map((k) => p[axis][k][1])); return [Math.min(...v), Math.max(...v)]; };
      const [h, v] = [range(across), range(up)];
      const line = (name, path, k, order, style) => ({
        name, type: 'line', ...style, lineStyle: { ...style.lineStyle, opacity: 0.25 + (0.75 * (order + 1)) / kept.length },
        data: path.filter(has).map((p) => [p[across][k][1], p[up][k][1], times[k]]),
      });
      return [{
        name: `stick_figure_${side}`, title: `Bones and muscles every 0.1 s, from the ${side} (Figure 5)`, alt: `Bones and paths of ${counted(ofMuscles.length, 'muscle')} from the ${side} at ${kept.length} instants`, rem: 26,
        option: ({ ink, width, height, still }) => {
          const [wide, high] = [width - GRID.left - (still ? LEGEND : GRID.right), height - GRID.top - GRID.bottom];
          const scale = 1.08 * Math.max((h[1] - h[0]) / wide, (v[1] - v[0]) / high, 1e-6);
          const ends = ([low, high], pixels) => ({ min: (low + high - scale * pixels) / 2, max: (low + high + scale * pixels) / 2 });
          const rounded = { formatter: (x) => String(Number(x.toFixed(2))), showMinLabel: false, showMaxLabel: false };
          return {
            xAxis: { type: 'value', name: `${across}, m`, ...ends(h, wide), axisLabel: rounded }, yAxis: { type: 'value', name: `${up}, m`, ...ends(v, high), axisLabel: rounded },
            tooltip: { formatter: (p) => tip`${p.seriesName}<br>${exact(p.value[2])} s<br>${across}: ${exact(p.value[0])} m<br>${up}: ${exact(p.value[1])} m` },
            series: kept.flatMap((k, order) => [
              ...ofBones.map(([, path]) => line('bones', path, k, order, { symbol: 'circle', symbolSize: 5, itemStyle: { color: ink }, lineStyle: { width: 3 } })),
              ...ofMuscles.map(([name, path], m) => line(name, path, k, order, { symbol: SYMBOLS[m % SYMBOLS.length], symbolSize: 3, itemStyle: { color: COLOURS[m % COLOURS.length] }, lineStyle: { width: 1.2 } })),
            ]),
          };
        },
      }];
    };
    return [...from('side', 'x', 'y'), ...from('front', 'z', 'y')];
  };

  const curves = () => report.curves.map((curve) => lines(slug(curve.title), `${curve.title} (${curve.figure})`, { x: curve.x, y: curve.y, series: curve.series, symbols: false }));

  return { now, jobs, regularity, muscles, axes, muscleNames, MEASURES, counted, distinct, exact, short, withUnit, axisName, slug, chartOption, ofLoads, loads, firstJob, ofJob, curves };
};
