// What is drawn of a surface: its triangles with a function on them, points and a region.

const LIT = `
  varying vec3 vNormal;
  vec3 lit(vec3 colour) {
    vec3 n = normalize(vNormal) * (gl_FrontFacing ? 1.0 : -1.0);
    float light = 0.42 + 0.5 * max(0.0, dot(n, normalize(vec3(0.35, 0.5, 0.8)))) + 0.16 * max(0.0, n.z);
    return colour * light;
  }`;

const SURFACE_VERTEX = `
  uniform mat4 uView; uniform mat4 uProject;
  attribute float value;
  varying float vValue; varying vec3 vNormal;
  void main() {
    vValue = value;
    vNormal = mat3(uView) * normal;
    gl_Position = uProject * uView * vec4(position, 1.0);
  }`;
const SURFACE_FRAGMENT = `
  ${LIT}
  uniform sampler2D uMap; uniform vec2 uRange; uniform vec3 uPlain; uniform float uField; uniform float uAlpha;
  varying float vValue;
  void main() {
    float t = clamp((vValue - uRange.x) / (uRange.y - uRange.x), 0.0, 1.0);
    vec3 colour = uField > 0.5 ? texture2D(uMap, vec2((t * 255.0 + 0.5) / 256.0, 0.5)).rgb : uPlain;
    gl_FragColor = vec4(lit(colour), uAlpha);
  }`;
const POINT_VERTEX = `
  uniform mat4 uView; uniform mat4 uProject; uniform float uPixels;
  attribute vec3 colour; attribute float size;
  varying vec3 vColour; varying float vSize;
  void main() {
    vColour = colour; vSize = size;
    vec4 p = uView * vec4(position, 1.0);
    p.z += 0.03;
    gl_Position = uProject * p;
    gl_PointSize = size * uPixels;
  }`;
const POINT_FRAGMENT = `
  varying vec3 vColour; varying float vSize;
  uniform vec3 uEdge;
  void main() {
    vec2 d = 2.0 * gl_PointCoord - 1.0;
    float r = length(d);
    float alpha = 1.0 - smoothstep(1.0 - 2.0 / vSize, 1.0, r);
    if (alpha < 0.05) discard;
    float z = sqrt(max(0.0, 1.0 - r * r));
    float light = 0.6 + 0.45 * dot(normalize(vec3(d.x, -d.y, z)), normalize(vec3(0.35, 0.5, 0.8)));
    float edge = smoothstep(1.0 - 4.5 / vSize, 1.0 - 2.5 / vSize, r);
    gl_FragColor = vec4(mix(vColour * light, uEdge, 0.8 * edge), alpha);
  }`;

let maps = null; // textures, made once

// The parts of a surface that all panels share.
class Shape {
  constructor(info) {
    this.info = info;
    this.positions = floats(info.positions);
    this.triangles = integers(info.triangles);
    this.source = info.source ? integers(info.source) : null;
    this.normals = normalsOf(this.positions, this.triangles);
    [this.low, this.high] = bounds(this.positions);
    this.centre = [0, 1, 2].map((axis) => (this.low[axis] + this.high[axis]) / 2);
    let radius = 0;
    for (let i = 0; i < this.positions.length; i += 3) {
      radius = Math.max(radius, Math.hypot(...this.centre.map((c, axis) => this.positions[i + axis] - c)));
    }
    this.radius = radius || 1;
  }

  place(vertex) { return this.positions.subarray(3 * vertex, 3 * vertex + 3); }
  original(vertex) { return this.source ? this.source[vertex] : vertex; }

  // Distances along edges from a vertex (Dijkstra); infinite where no edges lead.
  distances(from) {
    const n = this.info.vertices;
    this.edges ??= edgesOf(n, this.triangles, this.positions);
    const { offsets, targets, lengths } = this.edges;
    const far = new Float32Array(n).fill(Infinity), heap = [[0, from]];
    far[from] = 0;
    while (heap.length) {
      const [d, v] = pop(heap);
      if (d > far[v]) continue;
      for (let e = offsets[v]; e < offsets[v + 1]; e++) {
        const next = Math.fround(d + lengths[e]);
        if (next < far[targets[e]]) { far[targets[e]] = next; push(heap, [next, targets[e]]); }
      }
    }
    return far;
  }
}

function push(heap, item) {
  let i = heap.push(item) - 1;
  while (i > 0 && heap[(i - 1) >> 1][0] > item[0]) { heap[i] = heap[(i - 1) >> 1]; i = (i - 1) >> 1; }
  heap[i] = item;
}
function pop(heap) {
  const first = heap[0], last = heap.pop();
  if (!heap.length) return first;
  let i = 0;
  for (let child = 1; child < heap.length; child = 2 * i + 1) {
    if (child + 1 < heap.length && heap[child + 1][0] < heap[child][0]) child++;
    if (heap[child][0] >= last[0]) break;
    heap[i] = heap[child]; i = child;
  }
  heap[i] = last;
  return first;
}

function edgesOf(n, triangles, positions) {
  const offsets = new Uint32Array(n + 1);
  for (let t = 0; t < triangles.length; t++) offsets[triangles[t] + 1] += 2;
  for (let v = 0; v < n; v++) offsets[v + 1] += offsets[v];
  const targets = new Uint32Array(2 * triangles.length), lengths = new Float32Array(2 * triangles.length);
  const free = offsets.slice();
  const add = (a, b) => {
    lengths[free[a]] = Math.hypot(positions[3 * a] - positions[3 * b], positions[3 * a + 1] - positions[3 * b + 1],
      positions[3 * a + 2] - positions[3 * b + 2]);
    targets[free[a]++] = b;
  };
  for (let t = 0; t < triangles.length; t += 3) {
    const [a, b, c] = triangles.subarray(t, t + 3);
    add(a, b); add(a, c); add(b, a); add(b, c); add(c, a); add(c, b);
  }
  return { offsets, targets, lengths };
}

function bounds(positions) {
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  for (let i = 0; i < positions.length; i++) {
    low[i % 3] = Math.min(low[i % 3], positions[i]);
    high[i % 3] = Math.max(high[i % 3], positions[i]);
  }
  return [low, high];
}

// Normals at vertices: those of the faces, weighted by area.
function normalsOf(p, triangles, out = new Float32Array(p.length)) {
  out.fill(0);
  for (let t = 0; t < triangles.length; t += 3) {
    const a = 3 * triangles[t], b = 3 * triangles[t + 1], c = 3 * triangles[t + 2];
    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
    const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
    const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
    for (const i of [a, b, c]) { out[i] += nx; out[i + 1] += ny; out[i + 2] += nz; }
  }
  for (let i = 0; i < out.length; i += 3) {
    const size = Math.hypot(out[i], out[i + 1], out[i + 2]) || 1;
    out[i] /= size; out[i + 1] /= size; out[i + 2] /= size;
  }
  return out;
}

function geometry(attributes, index) {
  const it = new THREE.BufferGeometry();
  for (const [name, [array, size]] of Object.entries(attributes)) it.setAttribute(name, new THREE.BufferAttribute(array, size));
  if (index) it.setIndex(new THREE.BufferAttribute(index, 1));
  return it;
}

function drawn(kind, shape, vertexShader, fragmentShader, uniforms, more = {}) {
  const material = new THREE.ShaderMaterial({
    uniforms: { uView: { value: new THREE.Matrix4() }, uProject: { value: new THREE.Matrix4() }, ...uniforms },
    vertexShader, fragmentShader, side: 2, ...more,
  });
  const it = new kind(shape, material);
  it.frustumCulled = false;
  return it;
}

// What one panel draws.
class Skin {
  constructor(shape) {
    maps ??= { signed: mapTexture(DIVERGING), plain: mapTexture(UNIFORM) };
    this.shape = shape;
    this.scene = new THREE.Scene();
    this.positions = shape.positions.slice();
    this.values = new Float32Array(shape.info.vertices);
    const attributes = { position: [this.positions, 3], normal: [shape.normals.slice(), 3], value: [this.values, 1] };
    this.surface = drawn(THREE.Mesh, geometry(attributes, shape.triangles), SURFACE_VERTEX, SURFACE_FRAGMENT, {
      uMap: { value: maps.plain }, uRange: { value: new THREE.Vector2(0, 1) }, uField: { value: 0 }, uAlpha: { value: 1 },
      uPlain: { value: new THREE.Vector3(0.74, 0.77, 0.82) },
    });
    this.scene.add(this.surface);
    this.moved = false;
  }

  // Colours the surface by the values, from low to high; by none if there is no map.
  colour(map, low, high) {
    const uniforms = this.surface.material.uniforms;
    uniforms.uField.value = map ? 1 : 0;
    if (!map) return;
    uniforms.uMap.value = maps[map];
    uniforms.uRange.value.set(low, high > low ? high : low + 1);
    this.surface.geometry.attributes.value.needsUpdate = true;
  }

  // Other positions (P(k)), or the shape's own again.
  move(positions) {
    if (!positions && !this.moved) return;
    this.moved = Boolean(positions);
    this.positions.set(positions ?? this.shape.positions);
    const { position, normal } = this.surface.geometry.attributes;
    normalsOf(this.positions, this.shape.triangles, normal.array);
    position.needsUpdate = normal.needsUpdate = true;
  }

  // Points: [{ at, colour, size }]
  mark(points) {
    this.drop("points");
    if (!points.length) return;
    const positions = new Float32Array(points.flatMap(({ at }) => [...this.positions.subarray(3 * at, 3 * at + 3)]));
    const colours = new Float32Array(points.flatMap(({ colour }) => colour.map((x) => x / 255)));
    const shape = geometry({ position: [positions, 3], colour: [colours, 3], size: [new Float32Array(points.map((p) => p.size)), 1] });
    // Transparent at its rim only, so it may hide what is behind it.
    this.points = drawn(THREE.Points, shape, POINT_VERTEX, POINT_FRAGMENT,
      { uPixels: { value: 1 }, uEdge: { value: new THREE.Vector3(0.08, 0.09, 0.12) } }, { transparent: true });
    this.scene.add(this.points);
  }

  // A piece of the surface with vertices of its own.
  highlight(region) {
    this.drop("region");
    if (!region) return;
    const shape = geometry({ position: [region.positions, 3], normal: [normalsOf(region.positions, region.triangles), 3],
      value: [new Float32Array(region.positions.length / 3), 1] }, region.triangles);
    this.region = drawn(THREE.Mesh, shape, SURFACE_VERTEX, SURFACE_FRAGMENT, {
      uMap: { value: maps.plain }, uRange: { value: new THREE.Vector2(0, 1) }, uField: { value: 0 }, uAlpha: { value: 0.85 },
      uPlain: { value: new THREE.Vector3(1.0, 0.78, 0.16) },
    }, { polygonOffset: true, polygonOffsetFactor: -2, polygonOffsetUnits: -8, transparent: true });
    this.scene.add(this.region);
  }

  drop(name) {
    if (!this[name]) return;
    this.scene.remove(this[name]);
    this[name].geometry.dispose();
    this[name].material.dispose();
    this[name] = null;
  }

  look({ view, project }, pixels) {
    for (const it of [this.surface, this.points, this.region]) {
      if (!it) continue;
      it.material.uniforms.uView.value.copy(view);
      it.material.uniforms.uProject.value.copy(project);
      if (it.material.uniforms.uPixels) it.material.uniforms.uPixels.value = pixels;
    }
  }

  free() { ["points", "region", "surface"].forEach((name) => this.drop(name)); }
}
