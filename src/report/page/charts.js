// Charts as SVG: curves, bars, tables of numbers. Colours of text and lines come from the style sheet.

function ticks(low, high, wanted = 5) {
  const raw = (high - low) / wanted || 1, power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999);
  const list = [];
  for (let t = Math.ceil(low / step - 1e-9) * step; t <= high + step * 1e-9; t += step) list.push(Math.abs(t) < step * 1e-9 ? 0 : t);
  return list;
}

function legendOf(series) {
  if (series.length < 2 && !series[0]?.name) return null;
  const more = series.length > 12 ? element("li", {}, `and ${series.length - 12} more`) : null;
  return element("ul", { class: "series" }, series.slice(0, 12).map((it, i) =>
    element("li", {}, element("i", { style: `background:${it.colour ?? SERIES[i % SERIES.length]}` }), it.name)), more);
}

function figure(title, body, series = [], note = null) {
  return element("figure", { class: "chart" }, element("figcaption", {}, title), body, legendOf(series), note && element("p", {}, note));
}

const WIDTH = 380, HEIGHT = 210, LEFT = 52, RIGHT_SIDE = 10, TOP = 10, BOTTOM = 36;

function frameOf(xLow, xHigh, yLow, yHigh, chart, xTicks = true) {
  const x = (v) => LEFT + (v - xLow) / (xHigh - xLow || 1) * (WIDTH - LEFT - RIGHT_SIDE);
  const y = (v) => HEIGHT - BOTTOM - (v - yLow) / (yHigh - yLow || 1) * (HEIGHT - TOP - BOTTOM);
  const root = svg("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, role: "img", "aria-label": chart.title });
  for (const t of ticks(yLow, yHigh, 4)) {
    root.append(svg("line", { class: "grid", x1: LEFT, x2: WIDTH - RIGHT_SIDE, y1: y(t), y2: y(t) }));
    root.append(svg("text", { x: LEFT - 6, y: y(t) + 4, "text-anchor": "end" }, number(t)));
  }
  if (xTicks) for (const t of ticks(xLow, xHigh, 6)) root.append(svg("text", { x: x(t), y: HEIGHT - BOTTOM + 15, "text-anchor": "middle" }, number(t)));
  root.append(svg("line", { class: "axis", x1: LEFT, x2: WIDTH - RIGHT_SIDE, y1: y(Math.max(yLow, Math.min(0, yHigh))), y2: y(Math.max(yLow, Math.min(0, yHigh))) }));
  root.append(svg("text", { class: "label", x: (LEFT + WIDTH - RIGHT_SIDE) / 2, y: HEIGHT - 4, "text-anchor": "middle" }, chart.x));
  root.append(svg("text", { class: "label", x: -(TOP + HEIGHT - BOTTOM) / 2, y: 11, "text-anchor": "middle", transform: "rotate(-90)" }, chart.y));
  return { root, x, y };
}

function lineChart(chart) {
  const at = (it, i) => (it.x.length ? it.x[i] : i);
  const xs = chart.series.flatMap((it) => it.y.map((_, i) => at(it, i))), ys = chart.series.flatMap((it) => it.y).filter(Number.isFinite);
  const share = chart.y.startsWith("share") || chart.unitRange;
  const { root, x, y } = frameOf(Math.min(...xs), Math.max(...xs), Math.min(0, ...ys), share ? 1 : Math.max(...ys), chart);
  chart.series.forEach((it, s) => {
    const points = it.y.map((v, i) => [x(at(it, i)), y(v)]).filter(([, v]) => Number.isFinite(v));
    const path = svg("polyline", { points: points.map((p) => p.map((v) => v.toFixed(1)).join(",")).join(" "), class: "curve",
      stroke: it.colour ?? SERIES[s % SERIES.length], "stroke-dasharray": it.dashed ? "5 3" : null });
    path.append(svg("title", {}, it.name || chart.title));
    root.append(path);
  });
  const marker = svg("g", { class: "marker" });
  root.append(marker);
  // The values nearest to the pointer.
  root.addEventListener("pointermove", (event) => {
    const box = root.getBoundingClientRect(), px = (event.clientX - box.left) * WIDTH / box.width;
    marker.replaceChildren();
    const lines = [];
    chart.series.forEach((it, s) => {
      if (!it.y.length) return;
      let best = 0;
      it.y.forEach((_, i) => { if (Math.abs(x(at(it, i)) - px) < Math.abs(x(at(it, best)) - px)) best = i; });
      marker.append(svg("circle", { cx: x(at(it, best)), cy: y(it.y[best]), r: 3, fill: it.colour ?? SERIES[s % SERIES.length] }));
      lines.push(`${it.name ? `${it.name}: ` : ""}${number(it.y[best])} at ${number(at(it, best))}`);
    });
    root.setAttribute("aria-description", lines.join("; "));
    readout.textContent = lines.slice(0, 4).join("; ");
  });
  root.addEventListener("pointerleave", () => { marker.replaceChildren(); readout.textContent = ""; });
  const readout = element("output", {});
  return figure(chart.title, element("div", { class: "plot" }, root, readout), chart.series);
}

function barChart(chart) {
  const names = chart.marks.names, ys = chart.series.flatMap((it) => it.y).filter(Number.isFinite);
  const share = chart.y.startsWith("share");
  const { root, x, y } = frameOf(0, names.length, Math.min(0, ...ys), share ? 1 : Math.max(0, ...ys) * 1.03, chart, false);
  const every = Math.ceil(names.length / 12), slot = 0.82 / chart.series.length;
  names.forEach((name, i) => {
    if (i % every === 0) root.append(svg("text", { x: x(i + 0.5), y: HEIGHT - BOTTOM + 15, "text-anchor": "middle" }, name));
    chart.series.forEach((it, s) => {
      const v = it.y[i];
      if (!Number.isFinite(v)) return;
      const bar = svg("rect", { class: "bar", x: x(i + 0.09 + s * slot), width: Math.max(0.8, x(slot) - x(0) - 0.6), y: Math.min(y(v), y(0)),
        height: Math.abs(y(v) - y(0)), fill: it.colour ?? SERIES[s % SERIES.length] });
      bar.append(svg("title", {}, `${it.name ? `${it.name}, ` : ""}${name}: ${number(v)}`));
      root.append(bar);
    });
  });
  return figure(chart.title, element("div", { class: "plot" }, root), chart.series);
}

// Long bars beside their names: time by stage.
function listChart(title, rows, series) {
  const most = Math.max(...rows.flatMap((row) => row.values.map((v) => v ?? 0)), 1e-9);
  const body = element("table", { class: "bars" }, rows.map((row) => element("tr", {},
    element("th", { scope: "row" }, row.name),
    element("td", {}, row.values.map((v, s) => element("div", { class: "long" },
      element("i", { style: `width:${(100 * (v ?? 0) / most).toFixed(1)}%;background:${SERIES[s % SERIES.length]}` }),
      element("span", {}, secondsText(v))))))));
  return figure(title, body, series.length > 1 ? series : []);
}

function matrixChart(chart) {
  const columns = chart.marks.names, wide = columns.length > 12, most = Math.max(...chart.series.flatMap((row) => row.y), 1e-9);
  const cell = (row, i) => {
    const v = row.y[i], share = Math.round(100 * v / most);
    return element("td", { style: `background:color-mix(in srgb, var(--accent) ${share}%, transparent);color:${share > 50 ? "var(--card)" : "inherit"}`,
      title: `${row.name} → ${columns[i]}: ${number(v)}` }, v ? number(v) : "·");
  };
  const table = element("table", { class: wide ? "matrix dense" : "matrix" },
    element("tr", {}, element("th", {}), columns.map((name) => element("th", { scope: "col", title: name }, element("span", {}, name)))),
    chart.series.map((row) => element("tr", {}, element("th", { scope: "row" }, row.name), columns.map((_, i) => cell(row, i)))));
  return figure(chart.title, element("div", { class: "scroll" }, table), [], `rows: ${chart.y}; columns: ${chart.x}`);
}

function chartOf(chart) {
  return { lines: lineChart, bars: barChart, matrix: matrixChart }[chart.marks.kind](chart);
}

// Charts of one title are one chart; a matrix stands alone.
function merged(scene) {
  const charts = [];
  for (const side of scene.sides) {
    for (const chart of side.charts) {
      const address = side.nodes[chart.node].address, from = scene.sides.length > 1 ? `${side.name}: ${address}` : address;
      const alike = charts.filter((it) => it.title === chart.title && it.marks.kind === chart.marks.kind);
      const named = chart.series.map((it) => ({ ...it, name: it.name ? `${from}, ${it.name}` : from }));
      if (chart.marks.kind === "matrix") charts.push({ ...chart, title: `${chart.title} (${from})` });
      else if (alike.length && JSON.stringify(alike[0].marks) === JSON.stringify(chart.marks)) alike[0].series.push(...named);
      else charts.push({ ...chart, series: named });
    }
  }
  return charts;
}

// Curves that are equal are drawn once, under all their names.
function distinct(series) {
  const known = new Map();
  for (const it of series) {
    const key = JSON.stringify([it.x, it.y]);
    if (known.has(key)) known.get(key).names.push(it.name);
    else known.set(key, { ...it, names: [it.name] });
  }
  return [...known.values()].map((it) => ({ ...it, name: it.names.length > 3 ? `${it.names[0]} and ${it.names.length - 1} equal ones` : it.names.join(" = ") }));
}

function showCharts(scene) {
  const box = byId("charts");
  const charts = merged(scene).map((chart) => chartOf(chart.marks.kind === "matrix" ? chart : { ...chart, series: distinct(chart.series) }));
  const rows = scene.stages.map((stage) => ({ name: stage.kind, values: stage.costs.map((cost) => cost && cost.seconds) }));
  if (rows.length) charts.push(listChart("Time by stage", rows, scene.sides));
  box.replaceChildren(...charts);
}
