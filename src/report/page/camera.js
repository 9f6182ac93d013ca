// Cameras: one for all panels, or one for each. A camera is a turn, a zoom and a shift, in units of the shape's radius.

class Camera {
  constructor() { this.reset("Y"); }

  // A first look from the side, a little from the front and above. `flat` is the axis along which the shape is thinnest.
  reset(up, flat = "X") {
    this.zoom = 1;
    this.shift = [0, 0];
    const axes = { X: new THREE.Vector3(1, 0, 0), Y: new THREE.Vector3(0, 1, 0), Z: new THREE.Vector3(0, 0, 1) };
    const upward = axes[up];
    const toward = axes[flat === up ? (up === "Y" ? "Z" : "Y") : flat].clone();
    const right = upward.clone().cross(toward);
    // Rows of the matrix take the scene's axes to the viewer's: right, up, toward the viewer.
    const basis = new THREE.Matrix4().makeBasis(right, upward, toward).transpose();
    this.turn = new THREE.Quaternion().setFromRotationMatrix(basis);
    this.rotate(-0.55, 0.22);
  }

  // Turns about the viewer's vertical and horizontal axes, in radians.
  rotate(horizontal, vertical) {
    const about = (x, y, angle) => new THREE.Quaternion().setFromAxisAngle(new THREE.Vector3(x, y, 0), angle);
    this.turn.premultiply(about(0, 1, horizontal)).premultiply(about(1, 0, vertical)).normalize();
  }

  scale(factor) { this.zoom = Math.max(0.2, Math.min(30, this.zoom * factor)); }
  move(x, y) { this.shift = [this.shift[0] + x, this.shift[1] + y]; }
  take(other) { [this.turn, this.zoom, this.shift] = [other.turn.clone(), other.zoom, [...other.shift]]; }
  copy() { return { turn: this.turn.toArray(), zoom: this.zoom, shift: [...this.shift] }; }

  // From the shape's coordinates to those of a panel of this aspect: x and y from -1 to 1.
  matrix(centre, radius, aspect) {
    const model = new THREE.Matrix4().makeRotationFromQuaternion(this.turn);
    model.multiply(new THREE.Matrix4().makeScale(1 / radius, 1 / radius, 1 / radius));
    model.multiply(new THREE.Matrix4().makeTranslation(-centre[0], -centre[1], -centre[2]));
    // A weak perspective: depth is seen, sizes stay comparable between panels.
    const distance = 6, fit = 1.08 / this.zoom, near = distance - 2.2, far = distance + 2.2;
    const wide = fit * Math.max(1, aspect), high = fit * Math.max(1, 1 / aspect);
    const shiftX = this.shift[0] * fit, shiftY = this.shift[1] * fit;
    const scale = near / distance;
    const project = new THREE.Matrix4().makePerspective(
      (-wide - shiftX) * scale, (wide - shiftX) * scale, (high - shiftY) * scale, (-high - shiftY) * scale, near, far);
    const back = new THREE.Matrix4().makeTranslation(0, 0, -distance);
    return { view: back.multiply(model), project };
  }
}

// Which way is up, and along which axis the shape is thinnest. Nothing is thinnest along its height that stands; of the
// other two axes the conventional Y is taken.
function posture(low, high) {
  const extent = [0, 1, 2].map((axis) => high[axis] - low[axis]);
  const flat = extent.indexOf(Math.min(...extent));
  return { up: flat === 1 ? "Z" : "Y", flat: "XYZ"[flat] };
}
