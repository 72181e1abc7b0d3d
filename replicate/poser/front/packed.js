// What Python packed, read back: gzip → a header in JSON, and typed arrays by their names.

const KINDS = {
  float32: Float32Array, uint32: Uint32Array, int16: Int16Array, uint16: Uint16Array, int8: Int8Array, uint8: Uint8Array,
};
const ALIGNMENT = 4; // bytes

// base64 → Uint8Array
function bytesOf(text) {
  const plain = atob(text);
  const bytes = new Uint8Array(plain.length);
  for (let i = 0; i < plain.length; i++) bytes[i] = plain.charCodeAt(i);
  return bytes;
}

// The values of all 65,536 patterns of 16 bits, as float16 has them.
function halfTable() {
  const table = new Float32Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const sign = bits & 0x8000 ? -1 : 1, exponent = (bits >> 10) & 31, fraction = bits & 1023;
    if (exponent === 0) table[bits] = sign * fraction * 2 ** -24;
    else if (exponent === 31) table[bits] = fraction ? NaN : sign * Infinity;
    else table[bits] = sign * (1 + fraction / 1024) * 2 ** (exponent - 15);
  }
  return table;
}

// Numbers in 16 bits, of which the lower bytes stand first and then the upper ones.
function joined(buffer, place, count, Kind) {
  const parts = new Uint8Array(buffer, place, 2 * count), bytes = new Uint8Array(2 * count);
  for (let i = 0; i < count; i++) {
    bytes[2 * i] = parts[i];
    bytes[2 * i + 1] = parts[count + i];
  }
  return new Kind(bytes.buffer);
}

// gzip (Uint8Array) → Promise of {header, arrays}; float16 becomes Float32Array. arrays[name] has a `shape`.
async function readPacked(gzip) {
  const stream = new Blob([gzip]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const arrays = {}, halves = halfTable();
  let place = 4 + length;
  for (const { name, kind, shape } of header.arrays) {
    const count = shape.reduce((a, b) => a * b, 1);
    const Kind = kind === "float16" ? Uint16Array : KINDS[kind];
    const size = count * Kind.BYTES_PER_ELEMENT;
    let values = Kind.BYTES_PER_ELEMENT === 2 ? joined(buffer, place, count, Kind) : new Kind(buffer, place, count);
    place += Math.ceil(size / ALIGNMENT) * ALIGNMENT;
    if (kind === "float16") values = Float32Array.from(values, (bits) => halves[bits]);
    values.shape = shape;
    arrays[name] = values;
  }
  return { header, arrays };
}
