// The state of a pose: control points and rig parameters, and which of them follows the other.

// packed → the pose. params: (m) within their limits; targets: (3c) where the control points are wanted, mm.
function createPose(packed) {
  const { header, arrays } = packed;
  const { limits, points, neutral } = arrays;
  const solve = inverseModel(packed), face = faceModel(packed), display = displayModel(packed);
  const m = header.controls.length, c = header.points.length;
  const normals = new Float32Array(neutral.length);
  const pose = {
    params: new Float32Array(m), targets: new Float32Array(3 * c), vertices: null, normals, display,
    displayVertices: null, displayNormals: display && new Float32Array(display.rest.length),
  };
  // Drags are told from here: the parameters and the control points when they last agreed, and what the networks say
  // of these points. What they say differs a little from the truth, and that little must not move a face at rest.
  const agreed = { params: null, said: null };

  const lower = (j) => limits[3 * j], usual = (j) => limits[3 * j + 1], upper = (j) => limits[3 * j + 2];
  const within = (j, value) => Math.max(lower(j), Math.min(upper(j), value));

  function show() {
    pose.vertices = face(pose.params);
    addNormals(pose.vertices, arrays.faces, normals);
    if (display) pose.displayVertices = display.pose(pose.params, pose.vertices);
  }
  // Where the mesh has its control point i, mm.
  pose.reached = (i) => Array.from(pose.vertices.subarray(3 * points[i], 3 * points[i] + 3));

  function agree() {
    agreed.params = Float32Array.from(pose.params);
    agreed.said = solve(pose.targets);
  }
  // Control point i is wanted at (x, y): the parameters change by as much as the networks' answer does.
  pose.drag = (i, x, y) => {
    pose.targets[3 * i] = x;
    pose.targets[3 * i + 1] = y;
    const now = solve(pose.targets);
    for (let j = 0; j < m; j++) pose.params[j] = within(j, agreed.params[j] + now[j] - agreed.said[j]);
    show();
  };
  // Parameters as they are wanted; the control points go where the mesh takes them, or to `targets`.
  pose.set = (params, targets = null) => {
    for (let j = 0; j < m; j++) pose.params[j] = within(j, params[j]);
    show();
    if (targets) pose.targets.set(targets);
    else for (let i = 0; i < c; i++) pose.targets.set(pose.reached(i), 3 * i);
    agree();
  };
  pose.reset = () => pose.set(Array.from({ length: m }, (_, j) => usual(j)));
  pose.reset();
  pose.rest = Float32Array.from(pose.targets); // where the face has its control points at rest, mm
  if (display) addNormals(pose.displayVertices, display.faces, pose.displayNormals);
  return pose;
}
