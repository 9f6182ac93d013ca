// The stage: one drawing surface under a grid of panels, the cameras, and what the pointer does.

const stage = byId("stage"), canvas = byId("canvas"), lineCanvas = byId("lines"), panelBox = byId("panels");
let renderer = null, noDrawing = null;
const eye = new THREE.PerspectiveCamera();
const sharedCamera = new Camera();
let panels = []; // { side, surface, title, group, skin, camera, cell, caption, rect }
const shapes = new Map(); // by their arrays; made when they are first drawn
function shapeOf(surface) {
  const info = scene.surfaces[surface], key = info.positions + info.triangles;
  if (!shapes.has(key)) shapes.set(key, new Shape(info));
  const shape = shapes.get(key);
  shape.info = info;
  return shape;
}
let due = false;

function startDrawing() {
  try {
    renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
    renderer.autoClear = false;
  } catch (error) {
    noDrawing = "This browser cannot draw in three dimensions (WebGL 2 is off), so shapes are not shown; all else is.";
  }
}

// Shows these panels, in groups that stay side by side. What is unchanged keeps its camera.
function setPanels(wanted) {
  const cameras = new Map(panels.map((panel) => [panel.id, panel.camera]));
  panels.forEach((panel) => panel.skin?.free());
  panelBox.replaceChildren();
  panels = wanted.map((it) => {
    const caption = element("div", { class: "caption" });
    const cell = element("div", { class: "panel", "data-id": it.id }, caption);
    panelBox.append(cell);
    const skin = renderer && new Skin(shapeOf(it.surface));
    return { ...it, cell, caption, skin, camera: cameras.get(it.id) ?? new Camera() };
  });
  const first = panels.find((panel) => !cameras.has(panel.id));
  if (first && cameras.size === 0) resetCameras();
  else for (const panel of panels) if (!cameras.has(panel.id)) frame(panel.camera, panel);
  layout();
}

function frame(camera, panel) {
  const { up, flat } = posture(shapeOf(panel.surface).low, shapeOf(panel.surface).high);
  camera.reset(state.up ?? up, flat);
}
function resetCameras() {
  if (!panels.length) return;
  frame(sharedCamera, panels[0]);
  panels.forEach((panel) => frame(panel.camera, panel));
  redraw();
}

// The grid that makes panels largest.
function layout() {
  const groups = [...new Set(panels.map((panel) => panel.group))];
  const per = Math.max(1, ...groups.map((group) => panels.filter((panel) => panel.group === group).length));
  const width = stage.clientWidth, height = stage.clientHeight;
  let best = [0, 1];
  for (let columns = 1; columns <= groups.length; columns++) {
    const rows = Math.ceil(groups.length / columns);
    const size = Math.min(width / (columns * per), 1.25 * height / rows);
    if (size > best[0] * 1.02) best = [size, columns];
  }
  const columns = best[1], rows = Math.max(1, Math.ceil(groups.length / columns));
  const w = width / columns, h = height / rows;
  groups.forEach((group, g) => {
    const members = panels.filter((panel) => panel.group === group);
    members.forEach((panel, i) => {
      const rect = { x: (g % columns) * w + i * w / members.length, y: Math.floor(g / columns) * h, w: w / members.length, h };
      panel.rect = rect;
      Object.assign(panel.cell.style, { left: `${rect.x}px`, top: `${rect.y}px`, width: `${rect.w}px`, height: `${rect.h}px` });
      panel.cell.classList.toggle("joined", i > 0);
    });
  });
  redraw();
}

function redraw() {
  if (due) return;
  due = true;
  requestAnimationFrame(() => { due = false; draw(); });
}

const cameraOf = (panel) => (state.linked ? sharedCamera : panel.camera);

function draw() {
  const width = stage.clientWidth, height = stage.clientHeight;
  for (const panel of panels) {
    const shape = shapeOf(panel.surface);
    panel.look = cameraOf(panel).matrix(shape.centre, shape.radius, panel.rect.w / panel.rect.h);
  }
  if (renderer && width > 0 && height > 0) {
    const size = renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height) renderer.setSize(width, height, false);
    renderer.setScissorTest(false);
    renderer.setClearColor(0, 0);
    renderer.clear();
    renderer.setScissorTest(true);
    for (const panel of panels) {
      const { x, y, w, h } = panel.rect, bottom = height - y - h;
      renderer.setViewport(x, bottom, w, h);
      renderer.setScissor(x, bottom, w, h);
      panel.skin.look(panel.look, renderer.getPixelRatio());
      renderer.render(panel.skin.scene, eye);
    }
  }
  drawLines(width, height);
}

// Where a displayed vertex is on the stage, how near, and whether it faces the viewer.
function seen(panel, vertex) {
  const p = panel.skin ? panel.skin.positions : shapeOf(panel.surface).positions;
  const n = panel.skin ? panel.skin.surface.geometry.attributes.normal.array : shapeOf(panel.surface).normals;
  const e = panel.look.view.elements, q = panel.look.project.elements, i = 3 * vertex;
  const across = (row, a, w) => e[row] * a[i] + e[row + 4] * a[i + 1] + e[row + 8] * a[i + 2] + w * e[row + 12];
  const ax = across(0, p, 1), ay = across(1, p, 1), az = across(2, p, 1);
  const toward = across(0, n, 0) * ax + across(1, n, 0) * ay + across(2, n, 0) * az;
  // The projection has a shift in its third column and the depth in its fourth row.
  const px = (q[0] * ax + q[8] * az) / -az, py = (q[5] * ay + q[9] * az) / -az;
  const { x, y, w, h } = panel.rect;
  return { x: x + (px + 1) / 2 * w, y: y + (1 - py) / 2 * h, depth: az, front: toward < 0 };
}

function drawLines(width, height) {
  const ratio = Math.min(2, window.devicePixelRatio || 1), context = lineCanvas.getContext("2d");
  if (lineCanvas.width !== width * ratio || lineCanvas.height !== height * ratio) {
    lineCanvas.width = width * ratio;
    lineCanvas.height = height * ratio;
  }
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  for (const { from, to, colour, bold, faint } of linesToDraw()) {
    const a = seen(...from), b = seen(...to);
    context.globalAlpha = bold ? 1 : (a.front && b.front ? 0.75 : 0.16) * (faint ? 0.35 : 1);
    context.strokeStyle = colour;
    context.lineWidth = bold ? 3 : 1.3;
    context.beginPath();
    context.moveTo(a.x, a.y);
    context.lineTo(b.x, b.y);
    context.stroke();
  }
}

function panelAt(x, y) {
  return panels.find(({ rect }) => x >= rect.x && x < rect.x + rect.w && y >= rect.y && y < rect.y + rect.h);
}

// The nearest of some displayed vertices at a place on the stage: of those within reach the one nearest to the viewer.
function vertexAt(panel, x, y, candidates, reach) {
  let best = null;
  for (const [index, vertex] of candidates) {
    const it = seen(panel, vertex);
    const apart = Math.hypot(it.x - x, it.y - y);
    const limit = typeof reach === "function" ? reach(index) : reach;
    if (apart <= limit && it.front && (!best || it.depth - apart * 0.01 > best.depth - best.apart * 0.01)) best = { index, vertex, apart, depth: it.depth };
  }
  return best;
}

function everyVertex(panel) {
  const n = shapeOf(panel.surface).info.vertices;
  return (function* () { for (let i = 0; i < n; i++) yield [i, i]; })();
}

function pickAt(x, y) {
  const panel = panelAt(x, y);
  if (!panel || !panel.look) return null;
  const marks = panel.marks ?? [];
  const point = vertexAt(panel, x, y, marks.map((mark, i) => [i, mark.at]), (i) => marks[i].size / 2 + 3);
  if (point) return { panel, mark: marks[point.index], vertex: point.vertex };
  const vertex = vertexAt(panel, x, y, everyVertex(panel), 12);
  return vertex && { panel, vertex: vertex.vertex };
}

let drag = null;
stage.addEventListener("pointerdown", (event) => {
  if (event.target.closest("button, select, input")) return;
  const box = stage.getBoundingClientRect();
  drag = { x: event.clientX, y: event.clientY, travelled: 0, panel: panelAt(event.clientX - box.left, event.clientY - box.top) };
  stage.setPointerCapture(event.pointerId);
});
stage.addEventListener("pointermove", (event) => {
  const box = stage.getBoundingClientRect();
  if (!drag) return hover(event.clientX - box.left, event.clientY - box.top);
  const dx = event.clientX - drag.x, dy = event.clientY - drag.y;
  drag.travelled += Math.abs(dx) + Math.abs(dy);
  drag.x = event.clientX;
  drag.y = event.clientY;
  if (!drag.panel || drag.travelled < 4) return;
  byId("tip").hidden = true;
  const camera = cameraOf(drag.panel);
  if (event.shiftKey || event.buttons === 4 || event.buttons === 2) camera.move(2 * dx / drag.panel.rect.h, -2 * dy / drag.panel.rect.h);
  else camera.rotate(dx * 0.009, dy * 0.009);
  redraw();
});
stage.addEventListener("pointerup", (event) => {
  const box = stage.getBoundingClientRect();
  const clicked = drag && drag.travelled < 4;
  drag = null;
  if (clicked) choose(pickAt(event.clientX - box.left, event.clientY - box.top));
});
stage.addEventListener("pointercancel", () => { drag = null; });
stage.addEventListener("pointerleave", () => { byId("tip").hidden = true; });
stage.addEventListener("contextmenu", (event) => event.preventDefault());
stage.addEventListener("wheel", (event) => {
  event.preventDefault();
  const box = stage.getBoundingClientRect();
  const panel = panelAt(event.clientX - box.left, event.clientY - box.top);
  if (!panel) return;
  cameraOf(panel).scale(Math.exp(-event.deltaY * 0.0012));
  redraw();
}, { passive: false });

let hovering = 0;
function hover(x, y) {
  const now = performance.now();
  if (now - hovering < 60) return;
  hovering = now;
  const tip = byId("tip"), found = pickAt(x, y), text = found && describe(found);
  tip.hidden = !text;
  if (!text) return;
  tip.textContent = text;
  const left = x + 14 + tip.offsetWidth > stage.clientWidth ? x - 14 - tip.offsetWidth : x + 14;
  Object.assign(tip.style, { left: `${Math.max(0, left)}px`, top: `${Math.max(0, y - 30)}px` });
}

new ResizeObserver(() => panels.length && layout()).observe(stage);
