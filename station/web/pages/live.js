// The loop on the screen: its points are kept here, and only those that are new come. They are drawn as often as the
// browser draws: points that come faster are drawn together.
(() => {
  const loops = window.lmLoops = {};
  const draw = (id) => {
    const loop = loops[id], element = getElement(id);
    if (!element || !element.chart) { setTimeout(() => draw(id), 20); return; }  // not mounted yet
    loop.waits = false;
    element.chart.setOption({ series: [{ data: loop.points }] }, { lazyUpdate: true });
  };
  window.showLoop = (id, first, points) => {
    const loop = loops[id] = loops[id] || { points: [], waits: false };
    loop.points.length = Math.min(loop.points.length, first);
    loop.points.push(...points);
    if (loop.waits) return;
    loop.waits = true;
    requestAnimationFrame(() => draw(id));
  };
})();
