// --- robots ----------------------------------------------------------------------------------------------
for (const robot of [data.robot, data.ghost])
  if (robot) {
    robot.root = matrix(robot.root);
    for (const link of robot.links) {
      link.origin = matrix(link.origin);
      link.axis = new THREE.Vector3(...link.axis);
    }
  }

function places(robot, q) {
  const motion = new THREE.Matrix4();
  const out = [];
  for (const link of robot.links) {
    const value = (link.joint >= 0 ? link.factor * q[link.joint] : 0) + link.offset;
    const T = (link.parent >= 0 ? out[link.parent] : robot.root).clone().multiply(link.origin);
    if (link.kind === "revolute") T.multiply(motion.makeRotationAxis(link.axis, value));
    if (link.kind === "prismatic") T.multiply(motion.makeTranslation(...link.axis.clone().multiplyScalar(value).toArray()));
    out.push(T);
  }
  return out;
}

function effective_by_terms(q) { // see irbcal.modeling.joint_map.JointMap.static_parts
  const { gain, waves } = data.joint_map;
  const out = q.map((value, i) => value * (1 + gain[i]));
  for (const { joint, turns, cosine, sine } of waves) {
    const angle = turns.reduce((sum, n, i) => sum + n * q[i], 0);
    out[joint] += cosine * Math.cos(angle) + sine * Math.sin(angle);
  }
  return out;
}

function effective(q) { // the joint map: see irbcal.modeling.joint_map
  if (data.joint_map.waves) return effective_by_terms(q);
  const { gain, stiffness, phases, fourier } = data.joint_map;
  const out = q.map((value, i) => value * (1 + (gain[i] || 0)));
  if (stiffness[0] || stiffness[1]) {
    const fore = stiffness[1] * Math.sin(q[1] + q[2] + phases[1]);
    out[1] += stiffness[0] * Math.sin(q[1] + phases[0]) + fore;
    out[2] += fore;
  }
  if (fourier.some((value) => value))
    out[5] += fourier[0] * Math.cos(q[5]) + fourier[1] * Math.sin(q[5])
      + fourier[2] * Math.cos(2 * q[5]) + fourier[3] * Math.sin(2 * q[5]);
  return out;
}

const ghost_material = new THREE.MeshPhongMaterial({
  color: 0xb7c9da, transparent: true, opacity: 0.42, depthWrite: false, polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1,
});
const body_of = (...path) => viewer.scene_tree.find(["irbcal", ...path, "<object>"]).object;
const looks = []; // bodies of each link, and coarser ones where the robot has very many triangles
if (data.coarse) for (const k of data.meshes.map(String)) looks.push([body_of("robot", k), body_of("robot", k, "coarse")]);
function twin_of_robot(layer, material) {
  const twin = (body, ...path) => {
    const mesh = new THREE.Mesh(body.geometry, material);
    mesh.renderOrder = 2;
    viewer.set_object(["irbcal", layer, ...path], mesh);
    return mesh;
  };
  for (const k of data.meshes.map(String)) {
    const whole = twin(body_of("robot", k), k);
    if (data.coarse) looks.push([whole, twin(body_of("robot", k, "coarse"), k, "coarse")]);
  }
}
if (data.ghost) twin_of_robot("ghost", ghost_material);
const next_material = ghost_material.clone(); // the robot in the next pose of a plan
next_material.color.set(0x3f8fd8);
next_material.opacity = 0.34;
if (data.mode === "plan") twin_of_robot("next", next_material);
for (const [, coarse] of looks) coarse.visible = false;

function set_links(name, matrices) {
  for (const k of data.meshes)
    viewer.handle_command({ type: "set_transform", path: `/irbcal/${name}/${k}`, matrix: matrices[k].toArray() });
}

// how much the nominal robot's deviation is magnified: as the nominal errors are
const ghost_factor = () => state.factor[state.own && data.scale.nominal ? "nominal" : "common"];
function deviated(T, T_nominal, factor) { // the nominal place with its deviation magnified
  const p = new THREE.Vector3(), p_n = new THREE.Vector3(), s = new THREE.Vector3();
  const r = new THREE.Quaternion(), r_n = new THREE.Quaternion();
  T.decompose(p, r, s);
  T_nominal.decompose(p_n, r_n, s);
  const turn = r.clone().invert().multiply(r_n);
  if (turn.w < 0) turn.set(-turn.x, -turn.y, -turn.z, -turn.w);
  const half = Math.asin(Math.min(1, Math.hypot(turn.x, turn.y, turn.z)));
  const axis = new THREE.Vector3(turn.x, turn.y, turn.z).normalize();
  r.multiply(new THREE.Quaternion().setFromAxisAngle(axis, Math.min(2 * half * factor, Math.PI)));
  return new THREE.Matrix4().compose(p.lerp(p_n, factor), r, new THREE.Vector3(1, 1, 1));
}

