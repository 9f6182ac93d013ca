// What is known of a node, of a picked feature or vertex, and what sides differ in.

function rows(pairs) {
  return element("table", { class: "facts" }, pairs.filter(Boolean).map(([label, value]) =>
    element("tr", {}, element("th", { scope: "row" }, label), element("td", {}, value))));
}

const valueText = (value) => (typeof value === "string" ? value : JSON.stringify(value));

function nodeButton(side, index) {
  const node = scene.sides[side].nodes[index];
  return element("button", { type: "button", class: "link", onclick: () => selectNodes(side, [index]) }, node.address);
}

function nodeCard(side, index) {
  const node = scene.sides[side].nodes[index];
  const inputs = node.inputs.map(([port, label, from]) => [label ? `${port} [${label}]` : port, from === null ? "–" : nodeButton(side, from)]);
  const params = Object.entries(node.params ?? {}).map(([name, value]) => [name, valueText(value)]);
  const outcome = { hit: "from the cache", computed: "computed in this run" }[node.outcome] ?? node.outcome;
  return element("article", { class: `node ${node.outcome}` },
    element("h2", {}, node.address, element("small", {}, ` ${node.kind}`)),
    node.message && element("p", { class: "message" }, node.message),
    node.defects.map((text) => element("p", { class: "defect" }, `! ${text}`)),
    rows(node.summary),
    element("h3", {}, "Run"),
    rows([["outcome", outcome], node.seconds !== null && ["time", secondsText(node.seconds)], node.bytes !== null && ["output", bytesText(node.bytes)],
      ...node.why.map((text) => ["why", text])]),
    params.length ? [element("h3", {}, "Params"), rows(params)] : null,
    node.files.length ? [element("h3", {}, "Files"), rows(node.files)] : null,
    inputs.length ? [element("h3", {}, "Inputs"), rows(inputs)] : null,
    element("h3", {}, "Identity"),
    rows([["type", node.type], ["key", node.key ?? "–"], ["digest", node.digest ? node.digest.slice(0, 12) : "–"]]));
}

// The results, when no node is selected.
function resultCards() {
  const side = scene.sides[state.graphSide ?? 0] ?? scene.sides[0];
  if (!side) return [];
  const index = scene.sides.indexOf(side);
  return side.shown.slice(0, 40).map(([address, i]) => {
    const node = side.nodes[i];
    return element("article", { class: `node ${node.outcome}` },
      element("h2", {}, nodeButton(index, i), element("small", {}, ` ${node.kind}`)),
      node.message && element("p", { class: "message" }, node.message),
      node.defects.map((text) => element("p", { class: "defect" }, `! ${text}`)),
      rows(node.summary));
  });
}

function showDetails() {
  const box = byId("details");
  if (!state.node) return box.replaceChildren(...resultCards());
  const { side, nodes } = state.node;
  const back = element("button", { type: "button", class: "back", onclick: () => selectNodes(side, null) }, "← results");
  const cards = nodes.slice(0, 1).map((i) => nodeCard(side, i));
  const others = nodes.length > 1 && element("label", {}, "instance ", element("select", { onchange: (event) => {
    cards[0].replaceWith(cards[0] = nodeCard(side, Number(event.target.value)));
  } }, nodes.map((i) => element("option", { value: i }, scene.sides[side].nodes[i].address))));
  box.replaceChildren(...[back, others, ...cards].filter(Boolean));
}

// The point of the other surface that a point is matched with, in the correspondence shown.
function partnerOf(picked) {
  const view = currentView(), group = view?.kind === "pairs" && view.groups.find((it) => it.side === picked.side);
  if (!group) return null;
  const link = group.link, end = picked.end;
  const pair = setOf(link)?.pairs.find((it) => it.points[end] === picked.index);
  if (!pair) return null;
  const points = pointsFor(picked.side, link.surfaces[1 - end], link.points[1 - end]);
  return points && { pair, link, points, index: pair.points[1 - end], end: 1 - end };
}

function pointFacts(side, points, index) {
  const point = points.points[index], node = scene.sides[side].nodes[points.node];
  return rows([["of", `${node.address}, feature ${index}`], ["vertex", String(point.vertex)], ["k", String(point.k)], ["λ", `${number(point.lambda)} /length²`],
    ["scale", `${number(point.scale)} length`], ["energy", `${number(point.energy)} length`],
    points.regions && ["patch", `${points.regions.kinds[index]}, ${thousands(points.regions.sizes[index][1])} faces`],
    points.lacking[index] && ["no descriptor", points.lacking[index]]]);
}

function showPicked() {
  const box = byId("picked"), picked = state.picked;
  if (!picked) return box.replaceChildren();
  if (picked.index === undefined) {
    const shape = shapeOf(picked.surface), p = shape.place(picked.vertex);
    const fields = scene.sides[picked.side].fields.filter((it) => it.surface === picked.surface);
    const named = fields.map((field) => {
      const row = rowOf(field, state.k);
      return [`${field.name} ${field.levels.length > 1 ? field.levels[row].k : ""}`, `${number(valueAt(field, row, picked.vertex))} ${field.unit}`];
    });
    return box.replaceChildren(element("article", { class: "card" }, element("h2", {}, `Vertex ${shape.original(picked.vertex)} of ${shape.info.name}`),
      rows([["position", [...p].map(number).join(", ")], ...named])));
  }
  const points = scene.sides[picked.side].points[picked.points], partner = partnerOf(picked);
  const own = points.profiles[picked.index], other = partner?.points.profiles[partner.index];
  const series = [];
  if (own) series.push({ name: `feature ${picked.index} of ${scene.sides[picked.side].nodes[points.node].address}`, x: [], y: own });
  if (other) series.push({ name: `feature ${partner.index} of ${scene.sides[picked.side].nodes[partner.points.node].address}`, x: [], y: other });
  const cards = [element("article", { class: "card" }, element("h2", {}, `Feature ${picked.index}`), pointFacts(picked.side, points, picked.index))];
  if (partner) {
    const { pair } = partner, judged = verdict(pair, state.limit);
    cards.push(element("article", { class: "card" }, element("h2", {}, `matched with feature ${partner.index}`),
      pointFacts(picked.side, partner.points, partner.index),
      rows([["descriptor distance", number(pair.distance)],
        pair.error && ["error", `${pair.error[0] === null ? "no true image" : `${number(100 * pair.error[0])} % of √area`}: ${judged === "mirrored" ? "right up to symmetry" : judged}`]])));
  } else if (currentView()?.kind === "pairs") cards.push(element("article", { class: "card" }, element("h2", {}, "not matched")));
  if (series.length) {
    const names = series[0].y.map((_, i) => String(i + 1));
    cards.push(barChart({ title: "Descriptor", x: "eigenvalue of the patch", y: "normalised value", marks: { names }, series }));
  }
  box.replaceChildren(...cards);
}

function showDifferences() {
  const box = byId("differences");
  if (!scene.compared) return box.replaceChildren();
  const names = scene.sides.map((side) => side.name);
  const texts = (row) => row.values.map((cell) => (typeof cell === "string" ? "–" : cell.value ?? cell.failed));
  let node = null;
  const lines = scene.figures.flatMap((row) => {
    const values = texts(row), head = row.node === node ? [] : [element("tr", {}, element("th", { colspan: names.length + 1, class: "head" }, `${row.node} (${row.kind})`))];
    node = row.node;
    return [...head, element("tr", { class: new Set(values).size > 1 ? "differs" : "" }, element("th", { scope: "row" }, row.figure), values.map((v) => element("td", {}, v)))];
  });
  const table = element("table", { class: "figures" }, element("tr", {}, element("th", {}), names.map((name) => element("th", { scope: "col" }, name))), lines);
  const pairs = scene.differences.map((pair, i) => {
    const first = pair.diverging[0];
    const where = first ? `part first at ${first.node} (${first.kind}): ${first.text.join("; ") || "no known cause"}` : "no difference";
    return element("details", { open: i === 0 && scene.differences.length === 1 }, element("summary", {}, element("b", {}, `${pair.left} ↔ ${pair.right}`), ` ${where}`),
      pair.diverging.slice(1).map((it) => element("p", {}, `also at ${it.node} (${it.kind}): ${it.text.join("; ")}${it.effect ? "" : ", without effect"}`)),
      element("p", {}, `${pair.nodes.length} outputs differ, ${pair.equal} are the same`),
      pair.nodes.filter((it) => it.differences?.length || it.note).map((it) => element("div", {}, element("h4", {}, `${it.node} (${it.kind})`),
        rows((it.differences ?? []).map((d) => [d.figure, d.text])), it.note && element("p", {}, it.note))));
  });
  box.replaceChildren(element("h2", {}, "Differences"), ...pairs, element("h2", {}, "Figures"), element("div", { class: "scroll" }, table));
}
