// Does on a report page what `ask` says (see `Ask` in mod.rs), as a user would, and returns what is visible (`Seen`).
const visit = async (ask) => {
  const all = (selector) => [...document.querySelectorAll(selector)];
  const text = (id) => document.getElementById(id).textContent;
  const settled = () => new Promise((done) => setTimeout(done, 50));
  // The value of a cell, with all digits if it has more than it shows.
  const says = (cell) => cell.title || cell.textContent;
  const column = (name) => {
    const k = all('#jobs th button').findIndex((button) => button.dataset.column === name);
    return all('#jobs tbody tr').map((row) => says(row.children[k]));
  };
  const figures = () => all('[data-figure]').map((figure) => {
    const svg = figure.querySelector('svg');
    return { name: figure.dataset.figure, shapes: svg.querySelectorAll('path').length, broken: /NaN|Infinity|undefined/.test(svg.outerHTML) };
  });
  const filter = (words) => {
    const field = document.getElementById('filter');
    field.value = words;
    field.dispatchEvent(new Event('input'));
  };
  while (!window.sinew?.ready) await settled();
  const seen = {
    background: getComputedStyle(document.body).backgroundColor,
    across: document.documentElement.scrollWidth,
    counts: text('counts'),
    warnings: document.getElementById('warnings')?.parentElement.textContent ?? '',
    failures: all('#went tbody tr').length,
    sections: all('main > section').filter((section) => !section.hidden).map((section) => section.querySelector('h2').id),
    ranks: all('#ranks td a').length,
    jobs: column('index'),
    job: text('h-job'),
    muscles: all('#job > .scroll tbody tr').map((row) => [...row.children].map(says)),
    choices: all('#loads-choice label').map((label) => [label.firstChild.textContent, label.querySelector('select').value]),
    figures: figures(),
  };
  if (ask.hover) {
    const [box, { chart }] = [...window.sinew.drawn].find(([one]) => one.closest('[data-figure]').dataset.figure === ask.hover);
    const points = chart.getOption().series[0].data.length;
    seen.tips = Array.from({ length: points }, (_, dataIndex) => {
      chart.dispatchAction({ type: 'showTip', seriesIndex: 0, dataIndex });
      return all('div').filter((div) => box.contains(div)).map((div) => div.innerText ?? '').filter((words) => words.includes(': ')).pop();
    });
  }
  if (ask.sort) {
    seen.sorted = [1, 2].map(() => {
      all('#jobs th button').find((button) => button.dataset.column === ask.sort).click();
      const button = all('#jobs th button').find((one) => one.dataset.column === ask.sort);
      return { order: button.closest('th').ariaSort, focused: document.activeElement === button, values: column(ask.sort) };
    });
  }
  if (ask.map) {
    const choice = all('#loads-choice label').find((label) => label.firstChild.textContent === 'as').querySelector('select');
    choice.value = ask.map;
    choice.dispatchEvent(new Event('change'));
    seen.maps = figures();
  }
  if (ask.choose) {
    filter(ask.choose);
    seen.left = column('index');
    document.querySelector(`#jobs a[href="#job=${ask.choose}"]`).click();
    await settled();
    seen.chosen = { address: location.hash, job: text('h-job'), row: document.querySelector('#jobs tr.chosen')?.dataset.job };
  }
  return seen;
};
