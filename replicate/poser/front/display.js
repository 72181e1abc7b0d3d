// Eyeballs, brows and hair: meshes for display alone, which go with the face (no method approximates them).

// (packed) → null, or {count, faces, paint, finishes, framed, pose(params, vertices)}; pose returns vertices (3k).
function displayModel({ header, arrays }) {
  const words = header.display;
  if (!words) return null;
  const { neutral, limits } = arrays;
  const rest = Float32Array.from(arrays["display.vertices"], (x) => x * words.step_mm);
  const index = arrays["display.index"], near = index.shape[1], count = index.shape[0];
  const weight = Float32Array.from(arrays["display.weight"]);
  for (let i = 0; i < count; i++) {
    let sum = 0;
    for (let k = 0; k < near; k++) sum += weight[near * i + k];
    for (let k = 0; k < near; k++) weight[near * i + k] /= sum;
  }
  const posed = Float32Array.from(rest), offsets = new Float32Array(neutral.length);

  // How far along the way to its limit a control is: [which limit, share].
  function share(params, j) {
    const lower = limits[3 * j], middle = limits[3 * j + 1], upper = limits[3 * j + 2], p = params[j];
    return p >= middle ? [1, (p - middle) / (upper - middle || 1)] : [0, (middle - p) / (middle - lower || 1)];
  }

  function turnEye(eye, motions, params) {
    const sum = [0, 0, 0, 0, 0, 0];
    for (let j = 0; j < params.length; j++) {
      const [end, part] = share(params, j);
      if (part) for (let a = 0; a < 6; a++) sum[a] += part * motions[12 * j + 6 * end + a];
    }
    const angle = Math.hypot(sum[0], sum[1], sum[2]), c = Math.cos(angle), s = Math.sin(angle);
    const [ux, uy, uz] = sum.slice(0, 3).map((x) => (angle ? x / angle : 0));
    const [cx, cy, cz] = eye.centre, [dx, dy, dz] = sum.slice(3);
    for (const [first, last] of eye.parts) {
      for (let v = 3 * first; v < 3 * last; v += 3) {
        const x = rest[v] - cx, y = rest[v + 1] - cy, z = rest[v + 2] - cz, along = (ux * x + uy * y + uz * z) * (1 - c);
        posed[v] = x * c + (uy * z - uz * y) * s + ux * along + cx + dx;
        posed[v + 1] = y * c + (uz * x - ux * z) * s + uy * along + cy + dy;
        posed[v + 2] = z * c + (ux * y - uy * x) * s + uz * along + cz + dz;
      }
    }
  }

  function pose(params, vertices) {
    for (let i = 0; i < offsets.length; i++) offsets[i] = vertices[i] - neutral[i];
    for (let i = 0, n = 0; i < count; i++) {
      let x = rest[3 * i], y = rest[3 * i + 1], z = rest[3 * i + 2];
      for (let k = 0; k < near; k++, n++) {
        const w = weight[n], v = 3 * index[n];
        x += w * offsets[v];
        y += w * offsets[v + 1];
        z += w * offsets[v + 2];
      }
      posed[3 * i] = x;
      posed[3 * i + 1] = y;
      posed[3 * i + 2] = z;
    }
    words.eyes.forEach((eye, i) => turnEye(eye, arrays[`display.eye.${i}`], params));
    return posed;
  }

  const { finishes, framed } = words;
  return { rest, faces: arrays["display.faces"], paint: arrays["display.paint"], finishes, framed, pose };
}
