// Pose a face with a model that `make deploy` wrote, by onnxruntime-web (`npm install --no-save onnxruntime-web`):
// node pose_web.mjs deploy_teen.json deploy_teen_regional.onnx jaw_open=0.6 … > vertices.txt
// In a page the same calls do it: `fetch` takes the place of `readFile`, and the mesh comes from the GLB.
import { readFile } from "node:fs/promises";
import * as ort from "onnxruntime-web";

function refuse(words) {
  console.error(words);
  process.exit(2);
}

const [facts, model, ...words] = process.argv.slice(2);
if (!model) refuse("expected a JSON file, a model and control=number …");
const { controls } = JSON.parse(await readFile(facts, "utf8")); // in the order of the input
const pose = Float32Array.from(controls, (control) => control.default);
for (const word of words) {
  const [name, value] = word.split("="), place = controls.findIndex((control) => control.name === name);
  if (place < 0 || !value || !Number.isFinite(Number(value))) refuse(`${word}: expected control=number; ${facts} lists the controls`);
  pose[place] = Number(value);
}

ort.env.wasm.numThreads = 1; // a single pose is too small a task for more
const session = await ort.InferenceSession.create(await readFile(model));
const { vertices } = await session.run({ parameters: new ort.Tensor("float32", pose, [1, pose.length]) }); // mm
for (let i = 0; i < vertices.data.length; i += 3) console.log(vertices.data.slice(i, i + 3).join(" "));
