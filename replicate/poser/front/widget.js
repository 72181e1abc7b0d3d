// The poser as a notebook's widget: the kernel, which has the rig, says how far the face is from it.

const PATIENCE_MS = 4000; // after which an answer is taken for lost

function render({ model, el }) {
  const root = el.appendChild(document.createElement("div"));
  root.classList.add("in-notebook");
  let ended = false, stop = () => {};
  const bytes = model.get("packed");
  const start = mountPoser(root, new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength), {
    linked: false, changed: () => root.dispatchEvent(new Event("posed")),
  });
  start.then((mounted) => {
    if (mounted && ended) mounted.close();
    else if (mounted) stop = connect(model, root, mounted);
  });
  return () => {
    ended = true;
    stop();
  };
}

// Tells the kernel of poses, one at a time, and shows what it says. Returns what ends that.
function connect(model, root, mounted) {
  const { pose, stage, packed, view, redraw } = mounted;
  const legend = createErrors(stage, packed, view, redraw, (kind) => {
    model.set("kind", kind);
    model.save_changes();
  });
  let timer = 0, again = false;

  function tell() {
    legend.wait();
    again = Boolean(timer);
    if (again) return; // the answer to come asks once more
    timer = setTimeout(answered, PATIENCE_MS);
    model.set("params", Array.from(pose.params));
    model.set("targets", Array.from({ length: pose.targets.length / 3 }, (_, i) => Array.from(pose.targets.subarray(3 * i, 3 * i + 3))));
    model.set("asked", model.get("asked") + 1);
    model.save_changes();
  }
  function answered() {
    clearTimeout(timer);
    timer = 0;
    if (again) tell();
  }
  const isElsewhere = () => model.get("params").some((value, j) => Math.abs(value - pose.params[j]) > 1e-6)
    || model.get("targets").flat().some((value, i) => Math.abs(value - pose.targets[i]) > 1e-4);
  function follow() {
    if (!timer && isElsewhere()) mounted.show(model.get("params"), model.get("targets").flat());
  }
  function judged() {
    legend.show(model.get("errors"), model.get("kind"));
    if (model.get("errors").asked === model.get("asked")) answered();
    if (timer || again) legend.wait();
  }
  root.addEventListener("posed", tell);
  model.on("change:params change:targets", follow);
  model.on("change:errors", judged);
  if (isElsewhere()) mounted.show(model.get("params"), model.get("targets").flat());
  judged();
  return () => {
    clearTimeout(timer);
    model.off("change:params change:targets", follow);
    model.off("change:errors", judged);
    mounted.close();
  };
}

export default { render };
