// The tool bar and the legend: what may be chosen for the view that is shown.

function choice(label, name, options, selected, onchange) {
  return element("label", {}, `${label} `, element("select", { name, onchange: (event) => onchange(event.target.value) },
    options.map(([value, text]) => element("option", { value, selected: String(value) === String(selected) }, text))));
}
function tick(label, name, checked, onchange) {
  return element("label", { class: "tick" }, element("input", { type: "checkbox", name, checked, onchange: (event) => onchange(event.target.checked) }), ` ${label}`);
}
function slider(label, name, low, high, value, oninput) {
  const output = element("output", {}, String(value));
  return element("label", { class: "slider" }, `${label} `, element("input", { type: "range", name, min: low, max: high, step: 1, value,
    oninput: (event) => { output.textContent = event.target.value; oninput(Number(event.target.value)); } }), output);
}

function showControls() {
  const box = byId("controls"), focused = box.contains(document.activeElement) ? document.activeElement.name : null;
  const view = currentView(), parts = [];
  const all = views();
  if (!view) return box.replaceChildren();
  if (all.length > 1) parts.push(choice("View", "view", all.map((it) => [it.id, it.title]), view.id, (id) => setState({ view: id, picked: null })));
  if (scene.sides.length > 1) {
    parts.push(choice("Sides", "side", [["all", "all"], ...scene.sides.map((side, i) => [i, side.name])], state.side,
      (value) => setState({ side: value === "all" ? "all" : Number(value), picked: null })));
  }
  if (view.kind === "ranking") {
    parts.push(choice("Query", "query", view.ranking.lists.map((it, i) => [i, it.query.class ? `${it.query.name} (${it.query.class})` : it.query.name]), state.query,
      (query) => setState({ query: Number(query) })));
  }
  const families = familiesOf(view);
  if (families.length || state.picked) parts.push(choice("Colour by", "field", [["", "nothing"], ...families.map((name) => [name, name]),
    ...(state.picked ? [["distance", "distance from what is picked"]] : [])], state.field, (field) => setState({ field })));
  const levels = levelsOf(view, state.field);
  if (levels.length > 1) parts.push(slider("k", "k", levels[0], levels.at(-1), state.k, setK));
  const most = morphMost(view);
  if (most) {
    parts.push(tick("from the first eigenfunctions", "morph", state.morph, (morph) => setState({ morph })));
    if (state.morph) parts.push(slider("P(k)", "count", 1, most, Math.min(state.count, most), (count) => { state.count = count; refresh(); }));
  }
  if (panels.some((panel) => panel.points !== undefined)) parts.push(tick("features", "features", state.features, (features) => setState({ features })));
  if (view.kind === "pairs") {
    const sets = view.groups[0].link.sets;
    if (sets.length > 1) parts.push(choice("Pairs", "set", sets.map((set, i) => [i, set.name]), state.set, (set) => setState({ set: Number(set) })));
    const judged = view.groups.some(({ link }) => link.judge !== null);
    parts.push(choice("Coloured by", "pairColour", [...(judged ? [["truth", "right or wrong"]] : []), ["place", "place"], ["frequency", "frequency"]],
      pairColour(view), (value) => setState({ pairColour: value })));
    if (judged && pairColour(view) === "truth") {
      parts.push(choice("within", "limit", [[0.05, "5 %"], [0.1, "10 %"], [0.25, "25 %"]], state.limit, (limit) => setState({ limit: Number(limit) })));
    }
    parts.push(tick("lines", "lines", state.lines, (lines) => setState({ lines })));
  }
  if (panels.length > 1) parts.push(tick("cameras linked", "linked", state.linked, link));
  parts.push(choice("up", "up", [["Y", "Y"], ["Z", "Z"], ["X", "X"]], upNow(), (up) => { state.up = up; resetCameras(); }));
  parts.push(element("button", { type: "button", onclick: () => { state.up = null; resetCameras(); showControls(); } }, "first camera"));
  box.replaceChildren(...parts);
  if (focused) box.querySelector(`[name="${focused}"]`)?.focus();
}

const upNow = () => state.up ?? (panels.length ? posture(shapeOf(panels[0].surface).low, shapeOf(panels[0].surface).high).up : "Y");

function bar(map, low, centre, high, title) {
  return element("div", { class: "bar" }, element("span", {}, title), element("i", { style: `background:${gradient(map)}` }),
    element("div", { class: "ends" }, [low, centre, high].map((text) => element("span", {}, text))));
}

function showLegend(range) {
  const view = currentView(), parts = [], under = [];
  if (range) {
    const { low, high, signed, name, unit } = range;
    parts.push(bar(signed ? DIVERGING : UNIFORM, number(low), signed ? "0" : number((low + high) / 2), number(high), `${name}, ${unit}`));
  }
  if (view?.kind === "pairs") {
    const lines = view.groups.map(({ side, link }) => {
      const set = setOf(link), counts = { right: 0, mirrored: 0, wrong: 0, unknown: 0 };
      set.pairs.forEach((pair) => counts[verdict(pair, state.limit)]++);
      const about = pairColour(view) === "truth"
        ? Object.entries(counts).filter(([, n]) => n).map(([name, n]) => element("span", { class: "count" }, element("i", { style: `background:${VERDICTS[name]}` }),
          `${n} ${{ mirrored: "mirrored", unknown: "not judged" }[name] ?? name}`)) : [`${set.pairs.length} pairs`];
      const c = link.certificate;
      const proof = state.set < 1 && c ? `objective ${number(c.objective)}, bound ${number(c.bound)}, ${c.proved ? "proved optimal" : `gap ${number(c.gap)} (${number(100 * c.gap / Math.abs(c.objective || 1))} %)`}`
        : `objective ${number(set.objective)}`;
      return element("p", { class: "certificate" }, scene.sides.length > 1 ? `${scene.sides[side].name}: ` : "", about, element("span", {}, ` ${proof}`));
    });
    (lines.length > 1 ? under : parts).push(...lines);
  }
  if (view?.left) under.push(element("p", { class: "certificate" }, `${panels.length} shapes are shown, ${view.left} more are not: choose another view`));
  const byFrequency = panels.some((panel) => panel.marks?.length) && (view?.kind !== "pairs" || pairColour(view) === "frequency");
  if (byFrequency) {
    const [low, high] = frequencyRange();
    parts.push(bar(FREQUENCY, number(low), "", number(high), "features by λ, 1/length² (size: scale)"));
  }
  byId("legend").replaceChildren(...parts);
  byId("tally").replaceChildren(...under);
}
