// Dense layers, and the networks of inverse kinematics: control points → rig parameters (Eq. 7).

// x (inputs) → out (outputs): W x + b. weight: (outputs, inputs), row by row; bias: null for none.
function dense(weight, bias, x, out) {
  const inputs = x.length, outputs = out.length;
  for (let o = 0, w = 0; o < outputs; o++) {
    let a = bias ? bias[o] : 0, b = 0, c = 0, d = 0, i = 0; // four sums: the next product waits for none of them
    for (; i + 3 < inputs; i += 4, w += 4) {
      a += weight[w] * x[i];
      b += weight[w + 1] * x[i + 1];
      c += weight[w + 2] * x[i + 2];
      d += weight[w + 3] * x[i + 3];
    }
    for (; i < inputs; i++, w++) a += weight[w] * x[i];
    out[o] = a + b + c + d;
  }
  return out;
}

function leaky(x, slope) {
  for (let i = 0; i < x.length; i++) if (x[i] < 0) x[i] *= slope;
  return x;
}

function layersOf(arrays, prefix, count) {
  return Array.from({ length: count }, (_, i) => {
    const weight = arrays[`${prefix}.${i}.weight`], bias = arrays[`${prefix}.${i}.bias`];
    return { weight, bias, out: new Float32Array(bias.length) };
  });
}

// f_IK: a function from control points (3c) in mm to raw rig parameters (m).
function inverseModel({ header, arrays }) {
  const { layers, slope, axes, regions } = header.inverse;
  const [neutral, spread, rest, reach] = ["neutral", "spread", "default", "reach"].map((n) => arrays[`inverse.${n}`]);
  const networks = regions.map((_, j) => layersOf(arrays, `inverse.${j}`, layers));
  const inputs = regions.map((region) => new Float32Array(region.points.length * axes));
  const said = new Float32Array(rest.length); // how many regions drive a parameter
  for (const region of regions) for (const p of region.parameters) said[p]++;

  return function solve(points) {
    const total = new Float32Array(rest.length);
    regions.forEach((region, j) => {
      let x = inputs[j];
      region.points.forEach((point, i) => {
        for (let a = 0; a < axes; a++) {
          x[i * axes + a] = (points[3 * point + a] - neutral[3 * point + a]) / spread[axes * point + a];
        }
      });
      networks[j].forEach((layer, i) => {
        x = dense(layer.weight, layer.bias, x, layer.out);
        if (i < layers - 1) x = leaky(x, slope);
      });
      region.parameters.forEach((p, i) => (total[p] += x[i]));
    });
    for (let p = 0; p < total.length; p++) total[p] = rest[p] + (total[p] / Math.max(said[p], 1)) * reach[p];
    return total;
  };
}
