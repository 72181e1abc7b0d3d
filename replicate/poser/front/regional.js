// Our method: rig parameters → coefficients → the vertices of regional bases.

const LARGEST_FACTOR = 32767, MOST_SMALL_ROWS = 512; // 512 · 127 · 32767 < 2³¹

// Adds `count` rows of whole numbers to sums, each times its own factor, which are read from `from` on.
// Four rows at a time: sums are read and written a quarter as often.
function addRows(sums, rows, from, count, factor) {
  const n = sums.length;
  let c = 0;
  for (; c + 3 < count; c += 4) {
    const a = factor[from + c], b = factor[from + c + 1], d = factor[from + c + 2], e = factor[from + c + 3];
    for (let i = 0, j = c * n, k = j + n, l = k + n, m = l + n; i < n; i++, j++, k++, l++, m++) {
      sums[i] += a * rows[j] + b * rows[k] + d * rows[l] + e * rows[m];
    }
  }
  for (; c < count; c++) {
    const a = factor[from + c];
    for (let i = 0, j = c * n; i < n; i++, j++) sums[i] += a * rows[j];
  }
}

// Adds `count` rows of whole numbers to sums, each times a factor that is rounded to 16 bits of the largest one: products
// and sums of whole numbers take less time than others.
// whole, total: Int32Arrays, of as many numbers as there are rows and sums.
function addSmallRows(sums, rows, from, count, factor, whole, total) {
  let largest = 0;
  for (let c = 0; c < count; c++) largest = Math.max(largest, Math.abs(factor[from + c]));
  const step = largest / LARGEST_FACTOR;
  if (!(step > 0 && step < Infinity) || count > MOST_SMALL_ROWS) return addRows(sums, rows, from, count, factor);
  const n = sums.length;
  for (let c = 0; c < count; c++) whole[c] = Math.round(factor[from + c] / step);
  total.fill(0);
  let c = 0;
  for (; c + 3 < count; c += 4) {
    const a = whole[c], b = whole[c + 1], d = whole[c + 2], e = whole[c + 3];
    for (let i = 0, j = c * n, k = j + n, l = k + n, m = l + n; i < n; i++, j++, k++, l++, m++) {
      total[i] += Math.imul(a, rows[j]) + Math.imul(b, rows[k]) + Math.imul(d, rows[l]) + Math.imul(e, rows[m]);
    }
  }
  for (; c < count; c++) for (let i = 0, j = c * n; i < n; i++, j++) total[i] += Math.imul(whole[c], rows[j]);
  for (let i = 0; i < n; i++) sums[i] += step * total[i];
}

// Adds rows of three numbers, each times its own weight, to those of some vertices.
function addWeighted(vertices, members, weights, rows) {
  for (let i = 0; i < members.length; i++) {
    const v = 3 * members[i], weight = weights[i];
    for (let a = 0; a < 3; a++) vertices[v + a] += weight * rows[3 * i + a];
  }
}

// silu(first half) ∘ second half, into the first half
function multiply(both) {
  const half = both.length / 2;
  for (let i = 0; i < half; i++) both[i] = (both[i] / (1 + Math.exp(-both[i]))) * both[half + i];
  return both.subarray(0, half);
}

// Takes each value to what training saw at least and at most; one that is no number stays what it is.
function within(values, least, most) {
  for (let i = 0; i < values.length; i++) values[i] = Math.min(Math.max(values[i], least[i]), most[i]);
  return values;
}

// A function from raw rig parameters (m) to the coefficients of all regions' components, mm.
function coefficientModel({ header, arrays }) {
  const { layers: count, networks, gated, slope, length_mm: length } = header.regional;
  const scale = arrays["regional.scale"];
  const parts = Array.from({ length: networks }, (_, k) => {
    const layers = layersOf(arrays, `regional.${k}`, count);
    const limits = layers.slice(1).map((_, i) => ["least", "most"].map((name) => arrays[`regional.${k}.${i}.${name}`]));
    const [seen, lowest, highest, line] = ["seen", "lowest", "highest", "line"].map((n) => arrays[`regional.${k}.${n}`]);
    const own = new Float32Array(seen.length), bounded = own.slice(), straight = layers[count - 1].out.slice();
    return { layers, limits, seen, lowest, highest, line, own, bounded, straight };
  });
  const coefficients = new Float32Array(parts.reduce((sum, { straight }) => sum + straight.length, 0));

  return function coefficientsOf(params) {
    let first = 0;
    for (const { layers, limits, seen, lowest, highest, line, own, bounded, straight } of parts) {
      for (let i = 0; i < seen.length; i++) {
        bounded[i] = own[i] = params[seen[i]] / scale[seen[i]];
      }
      let x = within(bounded, lowest, highest); // beyond what training saw the line goes on alone
      layers.forEach((layer, i) => {
        x = dense(layer.weight, layer.bias, x, layer.out);
        if (i < count - 1) x = within(gated ? multiply(x) : leaky(x, slope), ...limits[i]);
      });
      if (line) dense(line, null, own, straight);
      for (let k = 0; k < straight.length; k++) coefficients[first + k] = (x[k] + straight[k]) * length;
      first += straight.length;
    }
    return coefficients;
  };
}

// (params, vertices) → nothing: places the vertices of all regions, mm; others are where they are at rest.
function regionalOffsets(packed) {
  const { header, arrays } = packed;
  const { neutral } = arrays;
  const coefficientsOf = coefficientModel(packed);
  const bases = Array.from({ length: header.regional.regions }, (_, k) => {
    const part = (name) => arrays[`basis.${k}.${name}`];
    const [members, weights, mean, fine, rough, steps] = ["vertices", "weights", "mean", "fine", "rough", "steps"].map(part);
    const whole = new Int32Array(rough.shape[0]), total = new Int32Array(mean.length);
    const factors = Float32Array.from(steps), sums = new Float32Array(mean.length);
    return { members, weights, mean, fine, rough, steps, factors, sums, whole, total };
  });
  const start = Float32Array.from(neutral);
  for (const { members, weights, mean } of bases) addWeighted(start, members, weights, mean);

  return function place(params, vertices) {
    const coefficients = coefficientsOf(params);
    let first = 0;
    vertices.set(start);
    for (const { members, weights, fine, rough, steps, factors, sums, whole, total } of bases) {
      for (let c = 0; c < steps.length; c++) factors[c] = coefficients[first + c] * steps[c];
      first += steps.length;
      sums.fill(0);
      addRows(sums, fine, 0, fine.shape[0], factors);
      addSmallRows(sums, rough, fine.shape[0], rough.shape[0], factors, whole, total);
      addWeighted(vertices, members, weights, sums);
    }
  };
}
