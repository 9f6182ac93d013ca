// The state of the page, what follows from it, and the keys.

let scene = null;
const state = { view: null, side: "all", field: "", k: 1, morph: false, count: 20, features: true, set: 0, pairColour: null, limit: 0.1,
  lines: true, linked: true, up: null, query: 0, picked: null, node: null, graphSide: 0, alone: null };

const sidesShown = () => scene.sides.map((_, i) => i).filter((i) => state.side === "all" || state.side === i);
const setOf = (link) => link.sets[Math.min(state.set, link.sets.length - 1)];

// What may be looked at: every correspondence, the shapes, and one surface that was asked for.
function views() {
  const list = [], addresses = new Set();
  scene.sides.forEach((side) => side.links.forEach((link) => addresses.add(side.nodes[link.node].address)));
  for (const address of addresses) {
    const groups = sidesShown().flatMap((side) => {
      const link = scene.sides[side].links.find((it) => scene.sides[side].nodes[it.node].address === address);
      return link ? [{ side, link }] : [];
    });
    if (groups.length) list.push({ id: `pairs ${address}`, title: `pairs: ${address}`, kind: "pairs", groups });
  }
  for (const side of sidesShown()) {
    for (const ranking of scene.sides[side].rankings) {
      if (!ranking.lists.length) continue;
      const of = scene.sides.length > 1 ? `${scene.sides[side].name}: ` : "";
      list.push({ id: `ranking ${side} ${scene.sides[side].nodes[ranking.node].address}`, kind: "ranking", side, ranking,
        title: `${of}ranking: ${scene.sides[side].nodes[ranking.node].address}` });
    }
  }
  const surfaces = sidesShown().flatMap((side) => surfacesOf(side).map((surface) => ({ side, surface })));
  if (surfaces.length) list.push({ id: "shapes", title: "shapes", kind: "shapes", surfaces });
  if (state.alone && scene.sides[state.alone.side]) {
    const { side, node } = state.alone, it = scene.sides[side].nodes[node];
    if (it?.surface !== null && it) list.push({ id: "alone", title: `surface: ${it.address}`, kind: "shapes", surfaces: [{ side, surface: it.surface }] });
  }
  return list;
}

// The surfaces of a side that something is shown on, or else all.
function surfacesOf(index) {
  const side = scene.sides[index], used = new Set([...side.fields, ...side.points].map((it) => it.surface));
  side.shown.forEach(([, node]) => { if (side.nodes[node].type === "mesh" && side.nodes[node].surface !== null) used.add(side.nodes[node].surface); });
  if (!used.size) side.nodes.forEach((node) => { if (node.surface !== null) used.add(node.surface); });
  return [...used].sort((a, b) => a - b);
}

function currentView() {
  const all = views();
  return all.find((it) => it.id === state.view) ?? firstView(all);
}
// The last correspondence whose truth is known, or else the last.
function firstView(all) {
  const pairs = all.filter((it) => it.kind === "pairs");
  return pairs.filter((it) => it.groups.some(({ link }) => link.judge !== null)).at(-1)
    ?? all.find((it) => it.kind === "ranking") ?? pairs.at(-1) ?? all[0] ?? null;
}

// A query and the first five that were found (fig. 9, 11).
function rankedPanels({ side, ranking }) {
  const { query, found } = ranking.lists[Math.min(state.query, ranking.lists.length - 1)];
  return [query, ...found.slice(0, 5)].flatMap((it, rank) => {
    if (it.surface === null) return [];
    const right = rank && it.class && query.class ? (it.class === query.class ? "right" : "wrong") : null;
    const detail = [it.class, rank ? number(it.score) : null, right && (right === "right" ? "✓ same class" : "✗ other class")].filter(Boolean).join(" · ");
    return [{ id: `${side} ranking ${rank} ${it.name}`, side, surface: it.surface, group: `rank ${rank}`, title: rank ? `${rank}. ${it.name}` : `query ${it.name}`,
      detail, verdict: right, points: pointsIndex(side, it.surface) }];
  });
}

const MOST_PANELS = 24;
function panelsOf(view) {
  if (!view) return [];
  if (view.kind === "ranking") return rankedPanels(view);
  const many = scene.sides.length > 1;
  const title = (side, surface) => (many ? `${scene.sides[side].name}: ${scene.surfaces[surface].name}` : scene.surfaces[surface].name);
  const panel = (side, surface, group, end, wanted) => ({ id: `${side} ${group} ${end ?? ""} ${scene.surfaces[surface].name}`, side, surface, group, end,
    title: title(side, surface), points: pointsIndex(side, surface, wanted) });
  const list = view.kind === "pairs"
    ? view.groups.flatMap(({ side, link }) => [0, 1].map((end) => panel(side, link.surfaces[end], side, end, link.points[end])))
    : view.surfaces.map(({ side, surface }) => panel(side, surface, many && view.surfaces.length <= 4 * sidesShown().length ? `s${side}` : `${side}.${surface}`));
  view.left = Math.max(0, list.length - MOST_PANELS);
  return list.slice(0, MOST_PANELS);
}

// The set of points shown on a surface: the one of this node, or the one that says most.
function pointsIndex(side, surface, node) {
  const all = scene.sides[side].points, on = all.map((_, i) => i).filter((i) => all[i].surface === surface);
  const chosen = state.node && state.node.side === side ? on.find((i) => state.node.nodes.includes(all[i].node)) : undefined;
  return on.find((i) => all[i].node === node) ?? chosen ?? on.filter((i) => all[i].profiles.length).at(-1) ?? on.at(-1);
}
function pointsFor(side, surface, node) {
  const index = pointsIndex(side, surface, node);
  return index === undefined ? null : scene.sides[side].points[index];
}

// Families of functions.
function familiesOf(view) {
  const sides = new Set(panelsOf(view).map((panel) => panel.side));
  return [...new Set([...sides].flatMap((side) => scene.sides[side].fields.map((field) => field.name)))];
}
function fieldOf(panel, name = state.field) {
  const side = scene.sides[panel.side], on = side.fields.filter((it) => it.surface === panel.surface && it.name === name);
  const chosen = state.node && state.node.side === panel.side ? on.find((it) => state.node.nodes.includes(it.node)) : null;
  return chosen ?? on.at(-1);
}
function levelsOf(view, name) {
  const all = panelsOf(view).flatMap((panel) => fieldOf(panel, name)?.levels.map((level) => level.k) ?? []);
  return all.length ? [Math.min(...all), Math.max(...all)] : [];
}
// The function that k means: the one whose number is k, or the cluster that k is in.
function rowOf(field, k) {
  let row = 0;
  field.levels.forEach((level, i) => { if (level.k <= k) row = i; });
  return row;
}
const spectralOf = (panel) => scene.sides[panel.side].fields.find((it) => it.surface === panel.surface && it.coefficients);
function morphMost(view) {
  const counts = panelsOf(view).map((panel) => spectralOf(panel)?.levels.length ?? 0);
  return Math.max(0, ...counts);
}
function pairColour(view) {
  if (state.pairColour) return state.pairColour;
  return view.groups.some(({ link }) => link.judge !== null) ? "truth" : "place";
}
function frequencyRange() {
  const all = scene.sides.flatMap((side) => side.points.flatMap((set) => set.points.map((point) => point.lambda))).filter((x) => x > 0);
  return [Math.min(...all), Math.max(...all)];
}

// Shows the panels of the state anew.
function rebuild() {
  const view = currentView();
  state.view = view?.id ?? null;
  byId("stage").hidden = !view;
  setPanels(panelsOf(view));
  refresh();
  showControls();
  showPicked();
}

// Shows what is on the panels anew.
function refresh() {
  const view = currentView();
  for (const panel of panels) {
    if (panel.skin) panel.skin.move(state.morph ? morphed(panel) : null);
    panel.marks = marksOf(panel, view);
    panel.skin?.mark(panel.marks);
    panel.skin?.highlight(regionOf(panel));
  }
  colourPanels();
}

// P(k) = centre + the first k functions times their coefficients (eq. 17).
function morphed(panel) {
  const field = spectralOf(panel);
  if (!field) return null;
  const out = new Float32Array(3 * field.size), { centre, of } = field.coefficients, values = new Float32Array(field.size);
  for (let i = 0; i < out.length; i++) out[i] = centre[i % 3];
  for (let row = 0; row < Math.min(state.count, field.levels.length); row++) {
    const [x, y, z] = of[row];
    if (!x && !y && !z) continue;
    valuesOf(field, row, values);
    for (let i = 0; i < field.size; i++) { out[3 * i] += x * values[i]; out[3 * i + 1] += y * values[i]; out[3 * i + 2] += z * values[i]; }
  }
  return out;
}

function colourPanels() {
  let range = null;
  const add = (low, high, about) => { range = { low: Math.min(low, range?.low ?? low), high: Math.max(high, range?.high ?? high), ...about }; };
  const shown = panels.map((panel) => {
    if (state.field === "distance") {
      if (!state.picked || state.picked.surface !== panel.surface || state.picked.side !== panel.side) return null;
      const far = shapeOf(panel.surface).distances(state.picked.vertex), finite = far.filter(Number.isFinite);
      add(0, finite.reduce((a, b) => Math.max(a, b), 0), { signed: false, name: "distance along edges", unit: "length" });
      return { values: far };
    }
    const field = state.field && fieldOf(panel);
    if (!field) return null;
    const row = rowOf(field, state.k), [low, high] = field.ranges[row], most = Math.max(Math.abs(low), Math.abs(high));
    const name = field.levels.length > 1 ? `${field.name} ${state.k}` : field.name;
    add(field.signed ? -most : low, field.signed ? most : high, { signed: field.signed, name, unit: field.unit });
    return { field, row };
  });
  panels.forEach((panel, i) => {
    const it = shown[i];
    if (it && panel.skin) {
      if (it.values) panel.skin.values.set(it.values);
      else valuesOf(it.field, it.row, panel.skin.values);
    }
    panel.skin?.colour(it ? (range.signed ? "signed" : "plain") : null, range?.low, range?.high);
    caption(panel, it);
  });
  showLegend(range);
  redraw();
}

function caption(panel, shown) {
  const info = scene.surfaces[panel.surface], level = shown?.field?.levels[shown.row];
  const size = info.source ? `${thousands(info.vertices)} of ${thousands(info.mesh[0])} vertices shown` : `${thousands(info.vertices)} vertices`;
  const function_ = level && level.lambda !== null ? `k = ${level.k}, λ = ${number(level.lambda)}` : null;
  panel.caption.replaceChildren(element("b", {}, panel.title), element("span", { class: panel.verdict ?? "" }, function_ ?? panel.detail ?? size));
  panel.cell.classList.toggle("wrong", panel.verdict === "wrong");
}

function setK(k) {
  state.k = k;
  colourPanels();
  if (state.picked && state.picked.index === undefined) showPicked();
}

// Points of a panel as they are drawn.
function marksOf(panel, view) {
  if (!state.features || panel.points === undefined) return [];
  const set = scene.sides[panel.side].points[panel.points], largest = Math.max(...set.points.map((point) => point.scale));
  const range = frequencyRange(), mode = view?.kind === "pairs" ? pairColour(view) : "frequency";
  const link = view?.kind === "pairs" ? view.groups.find((it) => it.side === panel.side).link : null;
  const pairs = new Map(link ? setOf(link).pairs.map((pair) => [pair.points[panel.end], pair]) : []);
  const picked = state.picked?.side === panel.side ? state.picked : null, partner = picked?.index !== undefined && link ? partnerOf(picked) : null;
  return set.points.map((point, index) => {
    const pair = pairs.get(index);
    let colour = sample(FREQUENCY, frequencyPlace(point.lambda, range));
    if (mode !== "frequency") colour = pair ? pairRgb(pair, link, mode) : [150, 155, 165];
    const size = mode === "frequency" ? 7 + 13 * Math.sqrt(point.scale / largest) : pair ? 11 : 6;
    const own = picked && picked.points === panel.points && picked.index === index && (picked.end ?? panel.end) === panel.end;
    const other = partner && partner.end === panel.end && partner.index === index;
    return { panel, index, at: set.at[index], colour: own || other ? [255, 214, 10] : colour, size: own || other ? size + 7 : size, pair };
  });
}

function pairRgb(pair, link, mode) {
  if (mode === "truth") return hex(VERDICTS[verdict(pair, state.limit)]);
  const shape = shapeOf(link.surfaces[0]);
  return placeColour(shape.place(pair.at[0]), shape.low, shape.high);
}

function linesToDraw() {
  const view = scene && currentView();
  if (view?.kind !== "pairs") return [];
  const lines = [];
  for (const { side, link } of view.groups) {
    const [left, right] = [0, 1].map((end) => panels.find((panel) => panel.side === side && panel.end === end));
    if (!left || !right) continue;
    const mode = pairColour(view), picked = state.picked?.side === side && state.picked.index !== undefined ? state.picked : null;
    for (const pair of setOf(link).pairs) {
      const bold = picked !== null && pair.points[picked.end] === picked.index;
      if (!state.lines && !bold) continue;
      const colour = css(pairRgb(pair, link, mode === "frequency" ? "place" : mode));
      lines.push({ from: [left, pair.at[0]], to: [right, pair.at[1]], colour: bold ? "#ffd60a" : colour, bold, faint: picked !== null });
    }
  }
  return lines;
}

// The patch of what is picked, on its panel or on the partner's.
function regionOf(panel) {
  const picked = state.picked;
  if (!picked || picked.index === undefined || picked.side !== panel.side || state.morph) return null;
  const own = picked.points === panel.points && (picked.end ?? panel.end) === panel.end ? picked.index : null;
  const partner = own === null && panel.end !== undefined ? partnerOf(picked) : null;
  const index = own ?? (partner && partner.end === panel.end ? partner.index : null);
  const regions = panel.points === undefined ? null : scene.sides[panel.side].points[panel.points].regions;
  if (index === null || index === undefined || !regions) return null;
  const before = regions.sizes.slice(0, index).reduce(([v, f], [w, g]) => [v + w, f + g], [0, 0]), [v, f] = regions.sizes[index];
  if (!f) return null;
  return { positions: floats(regions.positions).slice(3 * before[0], 3 * (before[0] + v)),
    triangles: integers(regions.triangles).slice(3 * before[1], 3 * (before[1] + f)) };
}

// A click on the stage.
function choose(found) {
  if (!found) return setState({ picked: null, field: state.field === "distance" ? "" : state.field });
  const { panel, mark, vertex } = found;
  setState({ picked: { side: panel.side, surface: panel.surface, end: panel.end, vertex, ...(mark ? { points: panel.points, index: mark.index } : {}) } });
}

// What the pointer is over, in a line.
function describe({ panel, mark, vertex }) {
  const shape = shapeOf(panel.surface), field = state.field && state.field !== "distance" && fieldOf(panel);
  const value = field ? `, ${number(valueAt(field, rowOf(field, state.k), vertex))}` : state.field === "distance" && panel.skin ? `, ${number(panel.skin.values[vertex])}` : "";
  if (!mark) return value && `vertex ${shape.original(vertex)}${value}`;
  const point = scene.sides[panel.side].points[panel.points].points[mark.index];
  return `feature ${mark.index}: k ${point.k}, scale ${number(point.scale)}${value}`;
}

function setState(change) {
  const shapesChange = ["view", "side", "node", "alone", "query"].some((key) => key in change);
  Object.assign(state, change);
  if (shapesChange) return rebuild();
  if ("field" in change) {
    const levels = levelsOf(currentView(), state.field);
    if (levels.length > 1) state.k = Math.max(levels[0], Math.min(levels.at(-1), state.k));
  }
  refresh();
  showControls();
  showPicked();
}

// Selects nodes of a side, or none, and shows their picture.
function selectNodes(side, nodes) {
  state.node = nodes && { side, nodes };
  markSelected();
  showDetails();
  if (!nodes) return;
  const it = scene.sides[side], node = nodes[0], at = (list) => list.find((layer) => layer.node === node);
  const address = it.nodes[node].address;
  if (at(it.links)) return setState({ view: `pairs ${address}` });
  if (at(it.rankings)) return setState({ view: `ranking ${side} ${address}` });
  const field = at(it.fields), points = at(it.points);
  if (field) return setState({ field: field.name, ...(shownHere(side, field.surface) ? { node: state.node } : { view: "shapes" }) });
  if (points) return setState({ features: true, ...(shownHere(side, points.surface) ? { node: state.node } : { view: "shapes" }) });
  if (it.nodes[node].type === "mesh" && it.nodes[node].surface !== null) return setState({ alone: { side, node }, view: "alone" });
  if (at(it.charts)) [...document.querySelectorAll("#charts figcaption")].find((caption) => caption.textContent.startsWith(at(it.charts).title))?.scrollIntoView({ block: "center" });
}
const shownHere = (side, surface) => panels.some((panel) => panel.side === side && panel.surface === surface);

// Cameras stay where they are when they are taken apart; the first panel's is the one when they are joined.
function link(linked) {
  if (linked) sharedCamera.take(panels[0]?.camera ?? sharedCamera);
  else panels.forEach((panel) => panel.camera.take(sharedCamera));
  setState({ linked });
}

function step(list, now, by) { return list[(list.indexOf(now) + by + list.length) % list.length]; }

const KEYS = {
  ArrowLeft: () => turn(-0.12, 0), ArrowRight: () => turn(0.12, 0), ArrowUp: () => turn(0, -0.12), ArrowDown: () => turn(0, 0.12),
  "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15),
  "[": () => stepK(-1), "]": () => stepK(1),
  n: () => stepThrough(1), p: () => stepThrough(-1),
  m: () => { const view = currentView(); if (view?.kind === "pairs") setState({ set: (state.set + 1) % view.groups[0].link.sets.length }); },
  v: () => setState({ view: step(views().map((it) => it.id), state.view, 1), picked: null }),
  l: () => setState({ lines: !state.lines }), c: () => link(!state.linked),
  r: () => { state.up = null; resetCameras(); showControls(); },
  t: () => changeTheme(), "?": () => byId("keys").showModal(),
  Escape: () => setState({ picked: null, field: state.field === "distance" ? "" : state.field }),
};
function turn(x, y) { (state.linked ? [sharedCamera] : panels.map((panel) => panel.camera)).forEach((camera) => camera.rotate(x, y)); redraw(); }
function zoom(by) { (state.linked ? [sharedCamera] : panels.map((panel) => panel.camera)).forEach((camera) => camera.scale(by)); redraw(); }
function stepK(by) {
  if (!state.field || state.field === "distance") return setState({ field: familiesOf(currentView())[0] ?? "" });
  const levels = levelsOf(currentView(), state.field);
  if (levels.length < 2) return;
  setK(Math.max(levels[0], Math.min(levels[1], state.k + by)));
  showControls();
}
// The next feature, or in a ranking the next query.
function stepThrough(by) {
  const view = currentView();
  if (view?.kind !== "ranking") return stepFeature(by);
  const n = view.ranking.lists.length;
  setState({ query: (state.query + by + n) % n });
}
function stepFeature(by) {
  const panel = panels.find((it) => state.picked && it.side === state.picked.side && it.surface === state.picked.surface && it.end === state.picked.end && it.marks?.length)
    ?? panels.find((it) => it.marks?.length);
  if (!panel) return;
  const n = panel.marks.length, now = state.picked?.index ?? (by > 0 ? -1 : 0), index = (now + by + n) % n;
  choose({ panel, mark: panel.marks[index], vertex: panel.marks[index].at });
}
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || !scene || byId("keys").open) return;
  const typing = event.target.closest?.("input, select, textarea, button, .box");
  if (typing && (event.key.startsWith("Arrow") || event.key === " " || event.target.tagName === "SELECT")) return;
  const action = KEYS[event.key];
  if (!action) return;
  event.preventDefault();
  action();
});

function changeTheme() {
  const dark = getComputedStyle(document.documentElement).getPropertyValue("--dark").trim() === "1";
  document.documentElement.dataset.theme = dark ? "light" : "dark";
  redraw();
}
byId("theme").addEventListener("click", changeTheme);
byId("help").addEventListener("click", () => byId("keys").showModal());

// Takes over a scene: what was chosen stays, as far as it is still there.
function show(next) {
  const first = scene === null;
  scene = next;
  for (const side of scene.sides) {
    for (const field of side.fields) {
      field.size = scene.surfaces[field.surface].vertices;
      let data = null;
      field.data = () => (data ??= shorts(field.values));
    }
  }
  const kept = new Set(scene.surfaces.map((info) => info.positions + info.triangles));
  for (const key of [...shapes.keys()]) if (!kept.has(key)) shapes.delete(key);
  if (state.side !== "all" && !scene.sides[state.side]) state.side = "all";
  if (state.node && !state.node.nodes.every((i) => scene.sides[state.node.side]?.nodes[i])) state.node = null;
  keepPicked();
  document.title = scene.title;
  byId("title").textContent = scene.title;
  const when = scene.when ? new Date(scene.when).toLocaleString() : "";
  byId("run").textContent = [scene.program, when, secondsText(scene.seconds), `${scene.sides.reduce((sum, side) => sum + side.nodes.length, 0)} nodes`].filter(Boolean).join(" · ");
  byId("notes").replaceChildren(...[noDrawing, ...scene.notes].filter(Boolean).map((text) => element("p", {}, text)));
  if (first && !state.field) state.field = "";
  showGraph(scene, selectNodes);
  showDetails();
  showDifferences();
  showCharts(scene);
  rebuild();
}

// A picked point or vertex that is not there any more is forgotten.
function keepPicked() {
  const picked = state.picked;
  if (!picked) return;
  const side = scene.sides[picked.side], surface = scene.surfaces[picked.surface];
  const there = side && surface && picked.vertex < surface.vertices;
  const point = picked.index === undefined || side?.points[picked.points]?.at[picked.index] === picked.vertex;
  if (!there || !point) state.picked = null;
}

function trouble(text) {
  byId("trouble").hidden = !text;
  byId("trouble").textContent = text ?? "";
}

startDrawing();
// For tests and for the curious: the page's state, and its drawing at once.
window.salient = { state, setState, setK, draw, seen, pick: pickAt, panels: () => panels, scene: () => scene, camera: () => panels.map((panel) => cameraOf(panel).copy()) };
if (embedded) show(JSON.parse(embedded.textContent));
else follow();
