// The scene and its arrays: from the page itself, or from the server that keeps it current.

const embedded = document.getElementById("scene");
const live = !embedded;
const arrays = new Map();

function decode(text) {
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes.buffer;
}

// The bytes of an array, loaded once.
function buffer(name) {
  if (!arrays.has(name)) {
    if (live) throw new Error(`array ${name} was not loaded`);
    const element = document.querySelector(`script[data-blob="${name}"]`);
    arrays.set(name, decode(element.textContent));
    element.textContent = "";
  }
  return arrays.get(name);
}

const floats = (name) => new Float32Array(buffer(name));
const integers = (name) => new Uint32Array(buffer(name));
const shorts = (name) => new Uint16Array(buffer(name));

// Names of all arrays that a scene uses.
function arrayNames(scene) {
  const names = new Set();
  for (const it of scene.surfaces) [it.positions, it.triangles, it.source].forEach((name) => name && names.add(name));
  for (const side of scene.sides) {
    for (const it of side.fields) names.add(it.values);
    for (const it of side.points) if (it.regions) names.add(it.regions.positions).add(it.regions.triangles);
  }
  return names;
}

// Live only: asks for what is not there yet, and forgets what is not used any more.
async function loadArrays(scene) {
  const wanted = arrayNames(scene);
  for (const name of [...arrays.keys()]) if (!wanted.has(name)) arrays.delete(name);
  const missing = [...wanted].filter((name) => !arrays.has(name));
  await Promise.all(missing.map(async (name) => {
    const answer = await fetch(`blob/${name}`);
    if (!answer.ok) throw new Error(`array ${name}: ${answer.status}`);
    arrays.set(name, await answer.arrayBuffer());
  }));
  return missing.length;
}

// The value of a function at a displayed vertex, or at all of them.
function valueAt(field, row, vertex) {
  const [low, high] = field.ranges[row];
  return low + (high - low) * field.data()[row * field.size + vertex] / 65535;
}

function valuesOf(field, row, out) {
  const [low, high] = field.ranges[row];
  const data = field.data(), start = row * field.size, step = (high - low) / 65535;
  for (let i = 0; i < field.size; i++) out[i] = low + step * data[start + i];
  return out;
}

// A number for people: four digits.
function number(x) {
  if (x === null || x === undefined) return "–";
  if (x === 0) return "0";
  const size = Math.abs(x);
  if (size >= 1e5 || size < 1e-3) return x.toExponential(2).replace("e-", "e−").replace("e+", "e").replace(/^-/, "−");
  return String(Number(x.toPrecision(4))).replace("-", "−");
}

// A time for people.
function secondsText(x) {
  if (x === null || x === undefined) return "–";
  if (x < 0.0995) return `${Number((1000 * x).toPrecision(2))} ms`;
  return `${x < 10 ? Number(x.toPrecision(2)) : Math.round(x)} s`;
}

const thousands = (n) => n.toLocaleString("en").replace(/,/g, " ");
function bytesText(n) {
  for (const unit of ["B", "kB", "MB"]) {
    if (n < 1000) return `${n < 10 && unit !== "B" ? n.toFixed(1) : Math.round(n)} ${unit}`;
    n /= 1000;
  }
  return `${n.toFixed(1)} GB`;
}

// Elements: element("p", { class: "x" }, "text", child)
function element(name, attributes = {}, ...children) {
  return fill(document.createElement(name), attributes, children);
}
function svg(name, attributes = {}, ...children) {
  return fill(document.createElementNS("http://www.w3.org/2000/svg", name), attributes, children);
}
function fill(node, attributes, children) {
  for (const [key, value] of Object.entries(attributes)) {
    if (key.startsWith("on")) node.addEventListener(key.slice(2), value);
    else if (value === true) node.setAttribute(key, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(key, value);
  }
  node.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return node;
}
const byId = (id) => document.getElementById(id);
