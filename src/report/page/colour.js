// Colours. Functions with a sign have a diverging map with zero at its centre, others a perceptually uniform one.

// A sample of Crameri's "vik" idea made of our own: blue through near-white to red, of equal lightness on both sides.
const DIVERGING = [[20, 55, 120], [48, 110, 180], [128, 176, 214], [243, 243, 240], [226, 158, 122], [190, 84, 48], [112, 28, 24]];
// Viridis (CC0, S. van der Walt and N. Smith), every 32nd colour.
const UNIFORM = [[68, 1, 84], [71, 44, 122], [59, 81, 139], [44, 113, 142], [33, 144, 141], [39, 173, 129], [92, 200, 99],
  [170, 220, 50], [253, 231, 37]];
// Low frequencies are red, high ones blue (fig. 7).
const FREQUENCY = [[196, 32, 38], [236, 112, 60], [248, 196, 106], [190, 214, 220], [92, 150, 200], [38, 74, 160]];
const RIGHT = "#0b8f6c", MIRRORED = "#8a63d2", WRONG = "#d9512c", UNKNOWN = "#8b919c";
const SERIES = ["#2f6fb5", "#d9792c", "#2c9467", "#b5467f", "#7a5cc4", "#94812a", "#3b9fb0", "#a0522d"];

function sample(map, t) {
  const x = Math.max(0, Math.min(1, t)) * (map.length - 1), i = Math.min(map.length - 2, Math.floor(x));
  return map[i].map((low, channel) => low + (map[i + 1][channel] - low) * (x - i));
}
const css = ([r, g, b]) => `rgb(${Math.round(r)},${Math.round(g)},${Math.round(b)})`;
const gradient = (map) => `linear-gradient(to right, ${map.map(css).join(", ")})`;

function mapTexture(map) {
  const data = new Uint8Array(256 * 4);
  for (let i = 0; i < 256; i++) data.set([...sample(map, i / 255).map(Math.round), 255], 4 * i);
  const texture = new THREE.DataTexture(data, 256, 1);
  texture.magFilter = texture.minFilter = 1006; // linear
  texture.needsUpdate = true;
  return texture;
}

function hex(text) {
  return [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16));
}

// By place: near places have near colours, so that pairs that cross are seen.
function placeColour(p, low, high) {
  return [0, 1, 2].map((axis) => {
    const extent = high[axis] - low[axis];
    return 40 + 195 * (extent > 0 ? (p[axis] - low[axis]) / extent : 0.5);
  });
}

// What a pair is worth where the truth is known; `limit` over the square root of the area.
function verdict(pair, limit) {
  if (!pair.error) return "unknown";
  const [plain, symmetric] = pair.error;
  if (plain !== null && plain <= limit) return "right";
  if (symmetric !== null && symmetric <= limit) return "mirrored";
  return "wrong";
}
const VERDICTS = { right: RIGHT, mirrored: MIRRORED, wrong: WRONG, unknown: UNKNOWN };

// Where a frequency lies among those of a scene, 0 the lowest, by its logarithm.
function frequencyPlace(lambda, [low, high]) {
  return high > low ? (Math.log(lambda) - Math.log(low)) / (Math.log(high) - Math.log(low)) : 0.5;
}
