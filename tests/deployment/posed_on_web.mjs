// node posed_on_web.mjs <folder of onnxruntime-web> <folder> <poses> <controls>: reads model.onnx and params from the folder,
// writes vertices beside them, all float32, and prints their shape.
import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";

const [place, folder, ...shape] = process.argv.slice(2);
const ort = createRequire(import.meta.url)(place);
ort.env.wasm.numThreads = 1;
const session = await ort.InferenceSession.create(readFileSync(`${folder}/model.onnx`), { logSeverityLevel: 3 });
const bytes = readFileSync(`${folder}/params`);
const params = new Float32Array(Uint8Array.from(bytes).buffer);
const { vertices } = await session.run({ parameters: new ort.Tensor("float32", params, shape.map(Number)) });
writeFileSync(`${folder}/vertices`, new Uint8Array(vertices.data.buffer, vertices.data.byteOffset, vertices.data.byteLength));
console.log(JSON.stringify(vertices.dims));
