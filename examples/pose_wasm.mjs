// Pose a face with the C file that `make deploy` wrote, as WebAssembly (ENGINES.md has the compiler's command):
// node pose_wasm.mjs deploy_teen.json teen.wasm jaw_open=0.6 … > vertices.txt
// The module imports nothing, so in a page the same lines do it, with `fetch` in the place of `readFile`.
import { readFile } from "node:fs/promises";

const PAGE = 65536; // bytes by which WebAssembly's memory grows

// wasm (bytes), counts → Promise of a function: parameters (m) → vertices (3n), mm, the same array each time.
export async function faceOf(wasm, controlCount, vertexCount) {
  const { memory, __heap_base, _initialize, ...others } = (await WebAssembly.instantiate(wasm)).instance.exports;
  const pose = others[Object.keys(others).find((name) => name.endsWith("_pose"))];
  const input = __heap_base.value, output = input + 4 * controlCount, end = output + 12 * vertexCount;
  memory.grow(Math.max(0, Math.ceil((end - memory.buffer.byteLength) / PAGE)));
  _initialize?.();
  const params = new Float32Array(memory.buffer, input, controlCount);
  const vertices = new Float32Array(memory.buffer, output, 3 * vertexCount);
  return (values) => {
    params.set(values);
    pose(input, output);
    return vertices;
  };
}

function refuse(words) {
  console.error(words);
  process.exit(2);
}

const [facts, wasm, ...words] = process.argv.slice(2);
if (!wasm) refuse("expected a JSON file, a .wasm and control=number …");
const { controls, vertex_count: count } = JSON.parse(await readFile(facts, "utf8")); // in the order of the parameters
const values = controls.map((control) => control.default);
for (const word of words) {
  const [name, value] = word.split("="), place = controls.findIndex((control) => control.name === name);
  if (place < 0 || !value || !Number.isFinite(Number(value))) refuse(`${word}: expected control=number; ${facts} lists the controls`);
  values[place] = Number(value);
}
const vertices = (await faceOf(await readFile(wasm), controls.length, count))(values);
for (let i = 0; i < vertices.length; i += 3) console.log(vertices.slice(i, i + 3).join(" "));
