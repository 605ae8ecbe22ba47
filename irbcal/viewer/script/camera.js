// --- camera ------------------------------------------------------------------------------------------------
viewer.camera.fov = 36;
viewer.camera.near = 0.02;
const AZIMUTH = data.tracker ? Math.atan2(tracker.y, tracker.x) + (58 * Math.PI) / 180 : (-50 * Math.PI) / 180;
const beside = new THREE.Vector3(-Math.sin(AZIMUTH), Math.cos(AZIMUTH), 0).multiplyScalar(0.8 * data.reach);
function extent(everything) { // the points that have to be inside the picture
  const out = [];
  const margin = 0.07 * data.reach;
  const add = (v, wide = margin) => {
    for (const sign of [-1, 1]) for (const axis of ["x", "y", "z"]) {
      const w = v.clone();
      w[axis] += sign * wide;
      out.push(w);
    }
  };
  for (const T of places(data.robot, poses.count ? joint_row(poses.effective, state.pose) : effective(state.q)))
    add(new THREE.Vector3().setFromMatrixPosition(T), 2 * margin);
  if (points) for (let row = 0; row < total; row++) out.push(point(points.at.calibrated, row));
  else {
    for (const place of tip_targets) add(place);
    if (data.cube) add(new THREE.Vector3(...data.cube.centre), data.cube.edge / 2);
  }
  for (const item of data.cell) if (!item.on_tip) add(new THREE.Vector3(...item.place));
  for (const item of data.features) add(new THREE.Vector3(...item.place));
  if (everything) {
    if (data.tracker) {
      add(tracker, 0.4);
      add(new THREE.Vector3(tracker.x, tracker.y, tracker.z - 1.3), 0.4);
    }
    for (const item of data.references) add(new THREE.Vector3(...item.place));
    if (data.ghost && state.ghost === "beside") add(beside, 0.5 * data.reach);
  }
  return out;
}
function look(everything) {
  const seen = extent(everything);
  const elevation = (16 * Math.PI) / 180;
  const back = new THREE.Vector3(Math.cos(elevation) * Math.cos(AZIMUTH), Math.cos(elevation) * Math.sin(AZIMUTH), Math.sin(elevation));
  const right = new THREE.Vector3(-Math.sin(AZIMUTH), Math.cos(AZIMUTH), 0);
  const up = back.clone().cross(right);
  const along = (v) => new THREE.Vector3(v.dot(right), v.dot(up), v.dot(back));
  const box = new THREE.Box3().setFromPoints(seen.map(along));
  const c = box.getCenter(new THREE.Vector3());
  const slope = Math.tan((viewer.camera.fov * Math.PI) / 360);
  const aspect = Math.max(pane.clientWidth, 1) / Math.max(pane.clientHeight, 1);
  let distance = 0;
  for (const v of seen) {
    const at = along(v).sub(c);
    distance = Math.max(distance, at.z + Math.max(Math.abs(at.y) / slope, Math.abs(at.x) / (slope * aspect)));
  }
  const centre = right.clone().multiplyScalar(c.x).addScaledVector(up, c.y).addScaledVector(back, c.z);
  const eye = centre.clone().addScaledVector(back, distance);
  viewer.camera.position.set(eye.x, eye.z, -eye.y); // meshcat's camera lives in axes with y up
  viewer.controls.target.set(centre.x, centre.z, -centre.y);
  viewer.controls.update();
  lamp.position.copy(back).addScaledVector(up, 0.8).addScaledVector(right, -0.5);
  viewer.set_dirty();
}

let gliding = 0;
function look_at_pose() { // nearer to the shown pose, from where the camera stands
  const rows = rows_of[state.pose] || [];
  if (!rows.length) return;
  const centre = new THREE.Vector3();
  for (const row of rows) centre.addScaledVector(point(points.at.calibrated, row), 1 / rows.length);
  const from = { eye: viewer.camera.position.clone(), to: viewer.controls.target.clone() };
  const back = from.eye.clone().sub(from.to);
  const aspect = Math.max(pane.clientWidth, 1) / Math.max(pane.clientHeight, 1);
  const distance = Math.min(back.length(), (1.7 * data.reach) / Math.min(aspect, 1));
  const to = new THREE.Vector3(centre.x, centre.z, -centre.y);
  const eye = to.clone().addScaledVector(back.normalize(), distance);
  const seconds = matchMedia("(prefers-reduced-motion: reduce)").matches ? 0 : 0.4;
  const mine = ++gliding;
  state.gliding = true;
  const begun = performance.now();
  const frame = (now) => {
    if (mine !== gliding) return;
    const part = seconds ? Math.min(Math.max((now - begun) / (1e3 * seconds), 0), 1) : 1;
    const soft = part * part * (3 - 2 * part);
    viewer.camera.position.lerpVectors(from.eye, eye, soft);
    viewer.controls.target.lerpVectors(from.to, to, soft);
    viewer.controls.update();
    viewer.set_dirty();
    if (part < 1) requestAnimationFrame(frame);
    else state.gliding = false;
  };
  requestAnimationFrame(frame);
}
function stop_gliding() {
  gliding++;
  state.gliding = false;
}
viewer.renderer.domElement.addEventListener("pointerdown", stop_gliding);
viewer.renderer.domElement.addEventListener("wheel", stop_gliding, { passive: true });
