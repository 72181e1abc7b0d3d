// The page: picture, points and sliders of one pose, and its ways out and in.

const TURN_PER_PX = 0.008, ZOOM_PER_PX = 0.0015, LINK_AFTER_MS = 250;
const MARKUP = `
  <div class="stage"><canvas></canvas><svg></svg><p class="problem" role="alert" hidden></p></div>
  <div class="panel">
    <div class="buttons">
      <button type="button" name="reset">Reset the pose</button>
      <button type="button" name="front">Front view</button>
      <button type="button" name="save">Save as a file</button>
      <button type="button" name="load">Load a file</button>
      <button type="button" name="dots" aria-pressed="true">Show the dots</button>
      <button type="button" name="keep" title="as one configuration of control points, a few lines of a table">Keep the drags</button>
      <button type="button" name="drags" title="as a CSV file that make table4 can read" disabled>Save kept drags</button>
      <input type="file" accept=".json,application/json" hidden>
    </div>
    <p class="status" role="status"></p>
    <div class="sliders"></div>
  </div>`;

// Puts the poser into an element. bytes: what Python packed, a Uint8Array. linked: whether the page's address follows the
// pose. changed(pose): called when somebody has changed the pose here. Returns a Promise of what `selfTest` takes; where
// the browser lacks something, the element says so, and the Promise is of null.
async function mountPoser(root, bytes, { linked = true, changed = () => {} } = {}) {
  root.classList.add("poser");
  root.innerHTML = MARKUP;
  const find = (selector) => root.querySelector(selector);
  const problem = find(".problem"), status = find(".status"), svg = find("svg"), stage = find(".stage");
  const refuse = (text) => {
    problem.textContent = `The face can't be shown: ${text}.`;
    problem.hidden = false;
    svg.remove();
    find(".panel").remove(); // there is nothing that its buttons could do
    return null;
  };
  if (typeof DecompressionStream === "undefined") {
    return refuse("this browser has no DecompressionStream, which the page unpacks itself with; any of 2023 or later has");
  }
  let packed, pose, view;
  try {
    packed = await readPacked(bytes);
    pose = createPose(packed);
    view = createView(find("canvas"), packed, pose.display);
  } catch (error) {
    return refuse(error.message);
  }

  let asked = false, linkTimer = 0, spent = 0;
  const say = (text, wrong = false) => {
    status.textContent = text;
    status.classList.toggle("wrong", wrong);
  };
  function draw() {
    asked = false;
    const from = performance.now();
    view.draw(pose.vertices, pose.normals, pose.displayVertices, pose.displayNormals);
    points.update();
    panel.update();
    find("canvas").title = `pose ${spent.toFixed(1)} ms, picture ${(performance.now() - from).toFixed(1)} ms`;
  }
  const redraw = () => {
    if (!asked) requestAnimationFrame(draw);
    asked = true;
  };
  function posed() {
    say("");
    redraw();
    clearTimeout(linkTimer);
    if (linked) linkTimer = setTimeout(() => writeLink(poseLink(packed, pose)), LINK_AFTER_MS);
  }
  const timed = (work) => {
    const from = performance.now();
    work();
    spent = performance.now() - from;
    posed();
    changed(pose);
  };

  const points = createPoints(svg, packed, pose, view, (i, x, y) => timed(() => pose.drag(i, x, y)));
  const panel = createPanel(find(".sliders"), packed, pose, (j, value) => {
    const params = Array.from(pose.params);
    params[j] = value;
    timed(() => pose.set(params));
  });
  const load = (read) => {
    try {
      const { params, targets } = read();
      timed(() => pose.set(params, targets));
      return true;
    } catch (error) {
      say(`${error.message}.`, true);
      return false;
    }
  };
  // A pose that comes from elsewhere: `changed` isn't called.
  const show = (params, targets) => {
    pose.set(params, targets);
    posed();
  };
  const file = find("input[type=file]"), kept = [];
  const click = {
    reset: () => timed(() => pose.reset()),
    front: () => { view.front(); redraw(); },
    save: () => saveText(poseText(packed, pose), `${packed.header.character}_pose.json`),
    load: () => file.click(),
    keep: () => {
      const drags = dragsOf(packed, pose);
      if (!drags.length) return say("Every control point is at rest: drag one, and keep the drags then.", true);
      kept.push(drags);
      find("button[name=drags]").disabled = false;
      say(`Configuration ${kept.length} is kept: ${drags.length} of ${packed.header.points.length} points are dragged.`);
    },
    drags: () => saveText(dragsText(kept), `${packed.header.character}_drags.csv`, "text/csv"),
    dots: (button) => {
      const hidden = svg.classList.toggle("without");
      button.setAttribute("aria-pressed", String(!hidden));
    },
  };
  for (const button of root.querySelectorAll("button")) button.addEventListener("click", () => click[button.name](button));
  file.addEventListener("change", async () => {
    const [chosen] = file.files;
    if (!chosen) return;
    const text = await chosen.text();
    if (load(() => readPose(packed, text))) say(`${chosen.name} is loaded.`);
    file.value = "";
  });
  listenToView(svg, view, redraw);
  const resized = new ResizeObserver(draw); // at once: what was drawn for the old size would be stretched
  resized.observe(stage);
  const fromLink = () => {
    const link = location.hash.slice(1);
    if (link.includes(".") && link !== poseLink(packed, pose)) load(() => readLink(packed, link));
  };
  if (linked) window.addEventListener("hashchange", fromLink);
  panel.open("mouth");
  if (linked) fromLink();
  redraw();
  const close = () => {
    resized.disconnect();
    view.close();
  };
  const link = () => poseLink(packed, pose);
  return { packed, pose, view, points, panel, load, link, show, draw, redraw, status, svg, stage, close };
}

// The background turns the view when it is dragged; the wheel brings it nearer.
function listenToView(svg, view, redraw) {
  let last = null;
  svg.addEventListener("pointerdown", (event) => {
    last = { id: event.pointerId, x: event.clientX, y: event.clientY };
    if (event.isTrusted) svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    if (!last || event.pointerId !== last.id) return;
    view.turnBy((event.clientX - last.x) * TURN_PER_PX, (event.clientY - last.y) * TURN_PER_PX);
    Object.assign(last, { x: event.clientX, y: event.clientY });
    redraw();
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => (last = null));
  svg.addEventListener("wheel", (event) => {
    const box = svg.getBoundingClientRect();
    view.zoomBy(Math.exp(-event.deltaY * ZOOM_PER_PX), event.clientX - box.left, event.clientY - box.top);
    redraw();
    event.preventDefault();
  }, { passive: false });
}

function saveText(text, name, kind = "application/json") {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: kind }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

function writeLink(link) {
  try {
    history.replaceState(null, "", `#${link}`);
  } catch {
    location.replace(`#${link}`); // where a page from disk may not change its own history
  }
}
