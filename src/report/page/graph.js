// The graph as a picture: layers from inputs to results. Instances of one node on an axis are one box when there are many.

const BOX_WIDTH = 104, BOX_HEIGHT = 31, GAP_X = 14, GAP_Y = 13, MANY = 60;

const template = (address) => address.replace(/\[[^\]]*\]/g, "");

// Boxes of a side: { key, nodes, layer, inputs }
function boxesOf(side) {
  const templates = new Set(side.nodes.map((node) => template(node.address))).size;
  const collapse = side.nodes.length > MANY || 3 * templates < side.nodes.length, boxes = new Map();
  const keyOf = (i) => (collapse ? template(side.nodes[i].address) : String(i));
  side.nodes.forEach((node, i) => {
    const key = keyOf(i), box = boxes.get(key) ?? { key, nodes: [], inputs: new Map(), layer: 0 };
    box.nodes.push(i);
    for (const [port, , from] of node.inputs) if (from !== null && keyOf(from) !== key) box.inputs.set(keyOf(from), port);
    boxes.set(key, box);
  });
  const list = [...boxes.values()];
  // Producers come before consumers, so that one pass would do; merged boxes may need more.
  for (let round = 0; round < 8; round++) {
    for (const box of list) for (const from of box.inputs.keys()) box.layer = Math.max(box.layer, Math.min(60, boxes.get(from).layer + 1));
  }
  return { list, boxes };
}

function place({ list, boxes }) {
  const layers = [];
  for (const box of list) (layers[box.layer] ??= []).push(box);
  layers.forEach((layer) => layer.forEach((box, i) => { box.order = i; }));
  // Boxes go near the mean of what they are joined to, a few times up and down.
  const consumers = new Map(list.map((box) => [box.key, []]));
  for (const box of list) for (const from of box.inputs.keys()) consumers.get(from).push(box);
  const middle = (box, of) => (of.length ? of.reduce((sum, it) => sum + it.x, 0) / of.length : box.x);
  const widest = Math.max(...layers.map((layer) => layer.length));
  const step = BOX_WIDTH + GAP_X;
  for (const layer of layers) layer.forEach((box, i) => { box.x = (i - (layer.length - 1) / 2) * step; });
  for (let round = 0; round < 6; round++) {
    const down = round % 2 === 0;
    for (const layer of down ? layers : [...layers].reverse()) {
      for (const box of layer) box.wish = middle(box, down ? [...box.inputs.keys()].map((key) => boxes.get(key)) : consumers.get(box.key));
      layer.sort((a, b) => a.wish - b.wish || a.order - b.order);
      // No closer than a step, and as near to the wishes as that allows.
      layer.forEach((box, i) => { box.x = i ? Math.max(box.wish, layer[i - 1].x + step) : box.wish; });
      const off = layer.reduce((sum, box) => sum + box.wish - box.x, 0) / layer.length;
      layer.forEach((box) => { box.x += off; });
    }
  }
  const low = Math.min(...list.map((box) => box.x));
  for (const box of list) {
    box.x += BOX_WIDTH / 2 - low + 4;
    box.y = box.layer * (BOX_HEIGHT + GAP_Y) + BOX_HEIGHT / 2 + 4;
  }
  return { width: Math.max(...list.map((box) => box.x)) + BOX_WIDTH / 2 + 4, height: layers.length * (BOX_HEIGHT + GAP_Y) + 4, widest };
}

const worst = (nodes) => ["failed", "skipped", "cancelled", "computed", "hit"].find((it) => nodes.some((node) => node.outcome === it));

function showGraph(scene, onSelect) {
  const holder = byId("graph");
  holder.replaceChildren();
  const side = scene.sides[state.graphSide] ?? scene.sides[0];
  if (!side || !side.nodes.length) return;
  if (scene.sides.length > 1) {
    holder.append(element("label", { class: "side" }, "graph of ", element("select", { onchange: (event) => {
      state.graphSide = Number(event.target.value);
      showGraph(scene, onSelect);
    } }, scene.sides.map((it, i) => element("option", { value: i, selected: i === (state.graphSide ?? 0) }, it.name)))));
  }
  const laid = boxesOf(side), { width, height } = place(laid);
  const shown = new Set(side.shown.map(([, node]) => node));
  const root = svg("svg", { viewBox: `0 0 ${width} ${height}`, width: width < 620 ? Math.min(width, byId("left").clientWidth - 36) : width, role: "group", "aria-label": "Graph of nodes" });
  for (const box of laid.list) {
    for (const [key, port] of box.inputs) {
      const from = laid.boxes.get(key), x0 = from.x, y0 = from.y + BOX_HEIGHT / 2, x1 = box.x, y1 = box.y - BOX_HEIGHT / 2;
      const bend = Math.max(8, (y1 - y0) / 2);
      root.append(svg("path", { class: "wire", d: `M${x0},${y0}C${x0},${y0 + bend} ${x1},${y1 - bend} ${x1},${y1}` },
        svg("title", {}, `${template(side.nodes[from.nodes[0]].address)} → ${port}`)));
    }
  }
  for (const box of laid.list) {
    const nodes = box.nodes.map((i) => side.nodes[i]), first = nodes[0];
    const name = box.nodes.length > 1 ? `${template(first.address)} ×${box.nodes.length}` : first.address;
    const seconds = nodes.reduce((sum, node) => sum + (node.outcome === "computed" ? node.seconds ?? 0 : 0), 0);
    const defects = nodes.some((node) => node.defects.length);
    const state = worst(nodes);
    const under = state === "computed" ? secondsText(seconds) : state === "hit" ? "cache" : state;
    const short = name.length > 16 ? `…${name.slice(-15)}` : name;
    const group = svg("g", { class: `box ${state}${box.nodes.some((i) => shown.has(i)) ? " shown" : ""}`, tabindex: 0, role: "button",
      "data-node": box.nodes[0], transform: `translate(${box.x - BOX_WIDTH / 2},${box.y - BOX_HEIGHT / 2})`,
      "aria-label": `${name}, ${first.kind}, ${under}` },
      svg("rect", { width: BOX_WIDTH, height: BOX_HEIGHT, rx: 5 }),
      svg("text", { x: BOX_WIDTH / 2, y: 13, "text-anchor": "middle", class: "name" }, short),
      svg("text", { x: BOX_WIDTH / 2, y: 25, "text-anchor": "middle", class: "under" }, under),
      defects ? svg("text", { x: BOX_WIDTH - 6, y: 13, "text-anchor": "end", class: "defect" }, "!") : null,
      svg("title", {}, `${name} (${first.kind})`));
    const select = () => onSelect(scene.sides.indexOf(side), box.nodes);
    group.addEventListener("click", select);
    group.addEventListener("keydown", (event) => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); select(); } });
    root.append(group);
  }
  holder.append(element("div", { class: "scroll" }, root),
    element("ul", { class: "outcomes" }, ["computed", "hit", "failed", "skipped"].filter((it) => side.nodes.some((node) => node.outcome === it))
      .map((it) => element("li", {}, element("i", { class: it }), `${{ hit: "from the cache" }[it] ?? it}: ${side.nodes.filter((node) => node.outcome === it).length}`))));
  markSelected();
}

function markSelected() {
  for (const box of document.querySelectorAll("#graph .box")) {
    const selected = state.node && Number(box.dataset.node) === state.node.nodes[0] && state.node.side === (state.graphSide ?? 0);
    box.classList.toggle("selected", Boolean(selected));
  }
}
