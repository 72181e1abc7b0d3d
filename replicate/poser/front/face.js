// From rig parameters to vertices: an approximation, rigid segments (§3.4) and normals.

// params (m) → vertices (3n), mm. The array that is returned is the same one each time.
function faceModel(packed) {
  const { header, arrays } = packed;
  const { neutral } = arrays;
  const place = header.regional ? regionalOffsets(packed) : mapOffsets(packed);
  const vertices = Float32Array.from(neutral);
  const segments = Array.from({ length: header.rigid }, (_, row) => ({
    members: arrays[`rigid.${row}.members`], carriers: arrays[`rigid.${row}.carriers`],
  }));

  return function pose(params) {
    place(params, vertices);
    for (const { members, carriers } of segments) {
      move(alignment(neutral, vertices, carriers), neutral, members, vertices);
    }
    return vertices;
  };
}

// The rigid motion that best takes some vertices from `source` to `target` (Eq. 3): {rotation (9, row vectors), shift}.
function alignment(source, target, indices) {
  const count = indices.length, from = [0, 0, 0], to = [0, 0, 0];
  for (const i of indices) {
    for (let a = 0; a < 3; a++) {
      from[a] += source[3 * i + a] / count;
      to[a] += target[3 * i + a] / count;
    }
  }
  const products = new Float64Array(9); // Σ (source − from)ᵀ (target − to)
  for (const i of indices) {
    for (let a = 0; a < 3; a++) {
      for (let b = 0; b < 3; b++) products[3 * a + b] += (source[3 * i + a] - from[a]) * (target[3 * i + b] - to[b]);
    }
  }
  const rotation = nearestRotation(products);
  const shift = to.map((value, b) => value - from.reduce((sum, x, a) => sum + x * rotation[3 * a + b], 0));
  return { rotation, shift };
}

// The rotation R of row vectors that maximises tr(Rᵀ M): the quaternion that is the largest eigenvector of a symmetric
// 4×4 matrix made of M (Horn 1987), by Jacobi's rotations. It is never a reflection.
function nearestRotation(m) {
  const size = Math.hypot(...m);
  const [xx, xy, xz, yx, yy, yz, zx, zy, zz] = m.map((v, i) => v + (i % 4 === 0 ? 1e-12 * size + 1e-300 : 0));
  const s = [
    [xx + yy + zz, yz - zy, zx - xz, xy - yx],
    [yz - zy, xx - yy - zz, xy + yx, zx + xz],
    [zx - xz, xy + yx, yy - xx - zz, yz + zy],
    [xy - yx, zx + xz, yz + zy, zz - xx - yy],
  ];
  const [w, x, y, z] = largestEigenvector(s);
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y),
    2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x),
    2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y),
  ];
}

// Of a symmetric matrix, which is overwritten.
function largestEigenvector(s) {
  const n = s.length, v = s.map((row, i) => row.map((_, j) => Number(i === j)));
  for (let sweep = 0; sweep < 30; sweep++) {
    let off = 0, all = 0;
    for (let i = 0; i < n; i++) for (let j = 0; j < n; j++) (i === j ? 0 : (off += s[i][j] ** 2)), (all += s[i][j] ** 2);
    if (off <= 1e-30 * all) break;
    for (let p = 0; p < n - 1; p++) {
      for (let q = p + 1; q < n; q++) {
        if (s[p][q] === 0) continue;
        const theta = (s[q][q] - s[p][p]) / (2 * s[p][q]);
        const t = (theta < 0 ? -1 : 1) / (Math.abs(theta) + Math.sqrt(theta * theta + 1));
        const c = 1 / Math.sqrt(t * t + 1), d = t * c;
        for (let k = 0; k < n; k++) [s[k][p], s[k][q]] = [c * s[k][p] - d * s[k][q], d * s[k][p] + c * s[k][q]];
        for (let k = 0; k < n; k++) [s[p][k], s[q][k]] = [c * s[p][k] - d * s[q][k], d * s[p][k] + c * s[q][k]];
        for (let k = 0; k < n; k++) [v[k][p], v[k][q]] = [c * v[k][p] - d * v[k][q], d * v[k][p] + c * v[k][q]];
      }
    }
  }
  let best = 0;
  for (let i = 1; i < n; i++) if (s[i][i] > s[best][best]) best = i;
  return v.map((row) => row[best]);
}

// Places some vertices as a rigid motion takes them from `source`.
function move({ rotation: r, shift }, source, indices, target) {
  for (const i of indices) {
    const x = source[3 * i], y = source[3 * i + 1], z = source[3 * i + 2];
    for (let b = 0; b < 3; b++) target[3 * i + b] = x * r[b] + y * r[3 + b] + z * r[6 + b] + shift[b];
  }
}

// Sums of face normals at vertices, of no particular length: the shader makes them unit vectors.
function addNormals(vertices, faces, normals) {
  normals.fill(0);
  for (let f = 0; f < faces.length; f += 3) {
    const a = 3 * faces[f], b = 3 * faces[f + 1], c = 3 * faces[f + 2];
    const ux = vertices[b] - vertices[a], uy = vertices[b + 1] - vertices[a + 1], uz = vertices[b + 2] - vertices[a + 2];
    const wx = vertices[c] - vertices[a], wy = vertices[c + 1] - vertices[a + 1], wz = vertices[c + 2] - vertices[a + 2];
    const x = uy * wz - uz * wy, y = uz * wx - ux * wz, z = ux * wy - uy * wx;
    normals[a] += x; normals[a + 1] += y; normals[a + 2] += z;
    normals[b] += x; normals[b + 1] += y; normals[b + 2] += z;
    normals[c] += x; normals[c + 1] += y; normals[c + 2] += z;
  }
  return normals;
}
