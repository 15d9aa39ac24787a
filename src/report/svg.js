'use strict';
// Returns every figure of a report as an SVG text for print: {file name: text}. Functions of time are those of the job with number `job`,
// or by default of the first converged job. Loads are drawn against each swept axis. Each file states what it shows and where it comes from;
// `drawn` is the hash of the drawing code.
const sinewSvg = (report, drawn, job) => {
  const WIDTH = 640;
  const PIXELS_PER_REM = 16;
  const PAPER = { ink: '#1b1f24', soft: '#57606a', line: '#d0d7de', paper: '#ffffff' };
  const MEASURES = ['mean_force_n', 'peak_force_n', 'mean_activation', 'peak_activation'];
  // Characters that XML does not allow.
  const NO_XML = /[\u0000-\u0008\u000b\u000c\u000e-\u001f\ufffe\uffff]/g;
  const { study, sinew } = report;
  const from = `sinew ${sinew.version}, solver ${sinew.solver}, study ${study.name} ${study.hash}, drawn by ${drawn}`;
  const escaped = (text) => text.replace(/[&<>]/g, (one) => ({ '&': '&amp;', '<': '&lt;', '>': '&gt;' })[one]);
  const figures = sinewFigures(report);
  const { jobs, axes } = figures;
  const row = job === undefined ? figures.firstJob() : jobs.values('index').indexOf(job);
  if (row < 0) throw new Error(`no job in the tables has the number ${job}`);
  const all = [...figures.curves()];
  if (figures.muscleNames.length) for (const x of axes) for (const measure of MEASURES) all.push(...figures.loads(figures.ofLoads({ x, measure })));
  if (jobs.rows) all.push(...figures.ofJob(row).map((figure) => ({ ...figure, name: `job-${jobs.at('index', row)}-${figure.name}` })));
  const seen = new Map();
  return Object.fromEntries(all.map((figure) => {
    const count = (seen.get(figure.name) ?? 0) + 1;
    seen.set(figure.name, count);
    const look = { ...PAPER, still: true, width: WIDTH, height: PIXELS_PER_REM * (figure.rem ?? 25) };
    const chart = echarts.init(null, null, { renderer: 'svg', ssr: true, width: look.width, height: look.height });
    chart.setOption({ ...figures.chartOption(figure, look), backgroundColor: PAPER.paper });
    const text = chart.renderToSVGString();
    chart.dispose();
    return [`${figure.name}${count > 1 ? `-${count}` : ''}.svg`, text.replace(NO_XML, '\ufffd').replace(/^<svg[^>]*>/, (open) => `${open}\n<title>${escaped(figure.alt)}</title>\n<desc>${escaped(from)}</desc>`)];
  }));
};
