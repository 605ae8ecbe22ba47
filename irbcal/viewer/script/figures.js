// --- marks and rods by the thousand ----------------------------------------------------------------------------
// Flat figures that face the watcher, those of a kind in one buffer. Without a graphics card an instance of a body takes as
// long as twenty triangles, whatever its own are.
function buffer_of(sizes, vertices) {
  const geometry = new THREE.BufferGeometry();
  for (const [name, size] of Object.entries(sizes)) {
    const bytes_each = name === "colour" ? Uint8Array : Float32Array;
    geometry.setAttribute(name, new THREE.BufferAttribute(new bytes_each(Math.max(vertices, 1) * size), size, name === "colour"));
  }
  return geometry;
}
function figures(name, mesh) {
  mesh.frustumCulled = false;
  viewer.set_object(["irbcal", ...name], mesh);
  return mesh;
}
function write(mesh, vertex, times, values) { // the same for all corners of a figure
  for (const [name, numbers] of Object.entries(values)) {
    const { array, itemSize } = mesh.geometry.attributes[name];
    for (let k = 0; k < times; k++) for (let c = 0; c < itemSize; c++) array[(vertex + k) * itemSize + c] = numbers[c];
  }
}
const bytes_of = (colour) => [255 * colour.r, 255 * colour.g, 255 * colour.b];

// marks: `square` (with an edge) or else diamonds, `wide` metres wide, `near` metres nearer to the watcher than they are
function marks(name, most, wide, near, square) {
  const material = new THREE.ShaderMaterial({
    alphaToCoverage: true,
    uniforms: { height: { value: 1 } },
    vertexShader: `attribute vec3 colour; attribute float size; uniform float height; varying vec3 tint; varying float pixels;
      void main() {
        vec4 at = modelViewMatrix * vec4(position, 1.0);
        pixels = max(size * ${wide.toFixed(6)} * height * projectionMatrix[1][1] / max(-2.0 * at.z, 1e-3), 1.5);
        at.xyz += normalize(-at.xyz) * ${near.toFixed(6)};
        gl_PointSize = pixels;
        gl_Position = projectionMatrix * at;
        tint = colour;
      }`,
    fragmentShader: `varying vec3 tint; varying float pixels;
      void main() {
        vec2 c = abs(gl_PointCoord - 0.5);
        ${square ? "gl_FragColor = vec4(tint * (max(c.x, c.y) * pixels > 0.5 * pixels - 1.0 && pixels > 4.0 ? 0.7 : 1.0), 1.0);"
    : "gl_FragColor = vec4(tint, clamp((0.5 - c.x - c.y) * pixels + 0.5, 0.0, 1.0)); if (gl_FragColor.a < 0.1) discard;"}
      }`,
  });
  const mesh = figures(name, new THREE.Points(buffer_of({ position: 3, colour: 3, size: 1 }, most), material));
  mesh.onBeforeRender = (renderer) => (material.uniforms.height.value = renderer.domElement.height);
  mesh.show = (count, hurry, most_now) => {
    mesh.count = count;
    mesh.geometry.setDrawRange(0, Math.min(count, most_now));
  };
  mesh.write = (slot, values) => write(mesh, slot, 1, values);
  return mesh;
}

// rods from `position` by `way`, `radius` thick; with `heads` they are arrows, and in a hurry needles
const SHAFT = [[0, -1, 0], [0, 1, 0], [1, -1, 0], [1, 1, 0]], HEAD = [[0, -1, 1], [0, 1, 1], [1, 0, 1]]; // along, across, of the head
function rods(name, most, thin, heads, opacity = 1) {
  const corners = heads ? [...SHAFT, ...HEAD] : SHAFT;
  const geometry = buffer_of({ position: 3, colour: 3, way: 3, width: 1 }, most * corners.length);
  const corner = Int8Array.from({ length: 4 * Math.max(most, 1) * corners.length }, (_, k) => corners[(k >> 2) % corners.length][k & 3] || 0);
  geometry.setAttribute("corner", new THREE.BufferAttribute(corner, 4));
  const triangles = (each) => new THREE.BufferAttribute(
    Uint32Array.from({ length: most * each.length }, (_, k) => corners.length * Math.floor(k / each.length) + each[k % each.length]), 1);
  const material = new THREE.ShaderMaterial({
    side: THREE.DoubleSide, transparent: opacity < 1,
    uniforms: { needle: { value: 0 } },
    vertexShader: `attribute vec3 colour, way; attribute float width; attribute vec4 corner; uniform float needle; varying vec3 tint;
      void main() {
        vec3 at = (modelViewMatrix * vec4(position, 1.0)).xyz, along = mat3(modelViewMatrix) * way;
        float far = length(along), tip = ${heads ? `mix(min(0.5 * far, ${(6 * radius).toFixed(6)}), far, needle)` : "0.0"};
        float half_width = corner.z > 0.5 ? (1.0 - corner.x) * mix(1.5, 0.9, needle) : ${thin.toFixed(3)};
        along /= max(far, 1e-9);
        at += along * (corner.z > 0.5 ? far - tip * (1.0 - corner.x) : (far - tip) * corner.x);
        vec3 across = cross(along, at);
        at += across / max(length(across), 1e-9) * corner.y * half_width * width * ${radius.toFixed(6)};
        gl_Position = projectionMatrix * vec4(at, 1.0);
        tint = colour;
      }`,
    fragmentShader: `varying vec3 tint; void main() { gl_FragColor = vec4(tint, ${opacity.toFixed(2)}); }`,
  });
  const mesh = figures(name, new THREE.Mesh(geometry, material));
  const whole = triangles(heads ? [0, 1, 2, 2, 1, 3, 4, 5, 6] : [0, 1, 2, 2, 1, 3]), needles = heads && triangles([4, 5, 6]);
  mesh.show = (count, hurry = false, most_now = count) => {
    mesh.count = count;
    material.uniforms.needle.value = heads && hurry ? 1 : 0;
    geometry.setIndex(heads && hurry ? needles : whole);
    geometry.setDrawRange(0, (geometry.index.count / Math.max(most, 1)) * Math.min(count, most_now));
  };
  mesh.write = (slot, values) => write(mesh, slot * corners.length, corners.length, values);
  return mesh;
}
