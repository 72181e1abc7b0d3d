// The paper's CNN: rig parameters → deformation maps, a segment each (Fig. 3) → the offsets that vertices read from them.

const GROUP = 4; // channels of an output that are added up together

const inGroups = (channels) => GROUP * Math.ceil(channels / GROUP);

// (params, vertices) → nothing: places the vertices of all segments, mm; those of the refinement on top.
function mapOffsets({ header, arrays }) {
  const { neutral } = arrays, scale = arrays["maps.scale"], scaled = new Float32Array(scale.length);
  const networks = header.maps.map((facts, k) => mapNetwork(facts, arrays, `maps.${k}`));

  return function place(params, vertices) {
    for (let p = 0; p < scaled.length; p++) scaled[p] = params[p] / scale[p];
    for (const { members } of networks) {
      for (const v of members) for (let a = 0; a < 3; a++) vertices[3 * v + a] = neutral[3 * v + a];
    }
    for (const network of networks) network.add(scaled, vertices);
  };
}

// One segment: {members, add(scaled, vertices)}. Only those pixels are worked out that a vertex comes to depend on.
function mapNetwork({ size, start, channels, dense: denseCount, convolutions, slope, length_mm: length }, arrays, prefix) {
  const own = (name) => arrays[`${prefix}.${name}`];
  const members = own("vertices"), parameters = own("parameters"), inputs = new Float32Array(parameters.length);
  const layers = layersOf(arrays, `${prefix}.dense`, denseCount);
  const { corners, shares } = readings(own("uv"), size);
  const depth = layers[denseCount - 1].out.length / start ** 2;
  const depths = [depth, ...Array(convolutions).fill(channels)];

  // The pixels that matter, from the vertices back: of the last convolution, which keeps the size, and of those before.
  let wanted = new Set(corners.flatMap((p) => [p, p + 1, p + size, p + size + 1])), width = size;
  const pixels = Array.from(wanted), steps = [];
  for (let i = convolutions - 1; i >= 0; i--) {
    const last = i === convolutions - 1, weight = own(`convolution.${i}.weight`), bias = own(`convolution.${i}.bias`);
    const source = last ? width : width / 2;
    const parts = (last ? [whole(weight)] : folded(weight)).map((kernel) => convolution(kernel, bias, wanted, source, depths[i]));
    steps.unshift(parts);
    wanted = new Set(parts.flatMap(({ reads }) => reads));
    width = source;
  }
  const widths = [start, ...steps.map((_, i) => Math.min(start * 2 ** (i + 1), size))];
  const images = widths.map((w, i) => new Float64Array((w + 2) ** 2 * inGroups(depths[i])));
  const weight = own("output.weight"), bias = own("output.bias"), wide = inGroups(channels);
  const map = new Float64Array(3 * size ** 2);

  function readMap() {
    const image = images[convolutions];
    for (const p of pixels) {
      const from = ((Math.floor(p / size) + 1) * (size + 2) + (p % size) + 1) * wide;
      for (let a = 0; a < 3; a++) {
        let sum = bias[a];
        for (let c = 0; c < channels; c++) sum += weight[a * channels + c] * image[from + c];
        map[3 * p + a] = sum;
      }
    }
  }

  function add(scaled, vertices) {
    for (let i = 0; i < inputs.length; i++) inputs[i] = scaled[parameters[i]];
    let x = inputs;
    layers.forEach((layer, i) => {
      x = dense(layer.weight, layer.bias, x, layer.out);
      if (i < denseCount - 1) x = leaky(x, slope);
    });
    for (let row = 0, i = 0; row < start; row++) {
      for (let column = 0; column < start; column++) {
        const to = ((row + 1) * (start + 2) + column + 1) * inGroups(depth);
        for (let c = 0; c < depth; c++, i++) images[0][to + c] = x[i];
      }
    }
    steps.forEach((parts, i) => parts.forEach((part) => convolve(images[i], images[i + 1], part, slope)));
    readMap();
    for (let i = 0; i < members.length; i++) {
      const p = 3 * corners[i], below = p + 3 * size, v = 3 * members[i];
      for (let a = 0; a < 3; a++) {
        vertices[v + a] += length * (shares[4 * i] * map[p + a] + shares[4 * i + 1] * map[p + 3 + a]
          + shares[4 * i + 2] * map[below + a] + shares[4 * i + 3] * map[below + 3 + a]);
      }
    }
  }
  return { members, add };
}

// Where vertices lie between the pixels of a map: the corner above and to the left of each, and the four shares.
function readings(uv, size) {
  const count = uv.length / 2, corners = [], shares = new Float64Array(4 * count);
  for (let i = 0; i < count; i++) {
    const [column, row] = [uv[2 * i], uv[2 * i + 1]].map((x) => Math.max(0, Math.min(size - 2, Math.floor(x * (size - 1)))));
    const a = uv[2 * i] * (size - 1) - column, b = uv[2 * i + 1] * (size - 1) - row;
    corners.push(row * size + column);
    shares.set([(1 - a) * (1 - b), a * (1 - b), (1 - a) * b, a * b], 4 * i);
  }
  return { corners, shares };
}

// A kernel is {taps, first, stride, parity, of(out, in, row, column)}: the sum over taps² pixels of the source, from `first`
// (row, column) on beside the one that the target lies in; targets are those of one parity of the upsampled image.

// The 3×3 convolution of an image in its own size.
function whole(weight) {
  const [, inputs] = weight.shape;
  const of = (o, i, row, column) => weight[((o * inputs + i) * 3 + row) * 3 + column];
  return { taps: 3, first: [-1, -1], stride: 1, parity: [0, 0], of };
}

// A 3×3 convolution after nearest upsampling is four of 2×2, one for each parity of row and column: a pixel and its copies
// have their weights together.
function folded(weight) {
  const [, inputs] = weight.shape;
  return [[0, 0], [0, 1], [1, 0], [1, 1]].map((parity) => {
    const place = (k, odd) => Math.floor((odd + k - 1) / 2) - (odd - 1);
    function of(o, i, row, column) {
      let sum = 0;
      for (let k = 0; k < 3; k++) {
        for (let l = 0; l < 3; l++) {
          if (place(k, parity[0]) === row && place(l, parity[1]) === column) sum += weight[((o * inputs + i) * 3 + k) * 3 + l];
        }
      }
      return sum;
    }
    return { taps: 2, first: parity.map((odd) => odd - 1), stride: 2, parity, of };
  });
}

// What `convolve` takes. Images have a border of zeros. wanted: pixels of the target; source: width of the source, of
// `depth` channels. reads: the pixels of the source that it needs.
function convolution({ taps, first, stride, parity, of }, bias, wanted, source, depth) {
  const width = stride * source, channels = bias.length, from = inGroups(depth), to = inGroups(channels);
  const own = Array.from(wanted).map((p) => [Math.floor(p / width), p % width])
    .filter(([row, column]) => stride === 1 || (row % 2 === parity[0] && column % 2 === parity[1]));
  const base = ([row, column]) => [Math.floor(row / stride) + first[0], Math.floor(column / stride) + first[1]];
  const targets = own.map(([row, column]) => ((row + 1) * (width + 2) + column + 1) * to);
  const sources = own.map(base).map(([row, column]) => ((row + 1) * (source + 2) + column + 1) * from);
  if (own.length % 2) { // `convolve` takes two pixels at a time
    targets.push(targets.at(-1));
    sources.push(sources.at(-1));
  }
  const reads = new Set();
  for (const [row, column] of own.map(base)) {
    for (let k = Math.max(row, 0); k < Math.min(row + taps, source); k++) {
      for (let l = Math.max(column, 0); l < Math.min(column + taps, source); l++) reads.add(k * source + l);
    }
  }
  const offsets = [], weight = new Float64Array(to * taps * taps * from);
  for (let k = 0; k < taps; k++) for (let l = 0; l < taps; l++) offsets.push((k * (source + 2) + l) * from);
  for (let o = 0; o < channels; o++) {
    for (let t = 0; t < taps * taps; t++) {
      for (let i = 0; i < depth; i++) {
        const place = ((Math.floor(o / GROUP) * taps * taps + t) * from + i) * GROUP + (o % GROUP);
        weight[place] = of(o, i, Math.floor(t / taps), t % taps);
      }
    }
  }
  const biases = new Float64Array(to);
  biases.set(bias);
  return {
    weight, biases, depth: from, sources: Int32Array.from(sources), targets: Int32Array.from(targets),
    offsets: Int32Array.from(offsets), reads: Array.from(reads),
  };
}

// Works out the targets of one convolution and its leaky ReLU: two pixels and four channels at a time, so that each number
// that is read serves for several products.
function convolve(input, output, { weight, biases, depth, sources, targets, offsets }, slope) {
  const size = offsets.length * depth * GROUP;
  for (let n = 0; n < sources.length; n += 2) {
    const p = sources[n], q = sources[n + 1], to = targets[n], other = targets[n + 1];
    for (let o = 0, start = 0; o < biases.length; o += GROUP, start += size) {
      let a = biases[o], b = biases[o + 1], c = biases[o + 2], d = biases[o + 3];
      let e = a, f = b, g = c, h = d, w = start;
      for (let t = 0; t < offsets.length; t++) {
        const from = p + offsets[t], beside = q + offsets[t];
        for (let i = 0; i < depth; i++, w += GROUP) {
          const x = input[from + i], y = input[beside + i];
          const w0 = weight[w], w1 = weight[w + 1], w2 = weight[w + 2], w3 = weight[w + 3];
          a += w0 * x; b += w1 * x; c += w2 * x; d += w3 * x;
          e += w0 * y; f += w1 * y; g += w2 * y; h += w3 * y;
        }
      }
      output[to + o] = a < 0 ? slope * a : a;
      output[to + o + 1] = b < 0 ? slope * b : b;
      output[to + o + 2] = c < 0 ? slope * c : c;
      output[to + o + 3] = d < 0 ? slope * d : d;
      output[other + o] = e < 0 ? slope * e : e;
      output[other + o + 1] = f < 0 ? slope * f : f;
      output[other + o + 2] = g < 0 ? slope * g : g;
      output[other + o + 3] = h < 0 ? slope * h : h;
    }
  }
}
