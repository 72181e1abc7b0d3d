// The control points on the picture: red dots to drag, and a line from each to where the mesh has its point.

const SVG = "http://www.w3.org/2000/svg";
const KEYS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
const KEY_MM = 0.5, DOT_PX = 5.5, GRIP_PX = 13;

// Returns {update}, which moves dots and lines to where pose and view have them. drag(i, x, y): point i is wanted there.
function createPoints(svg, { header }, pose, view, drag) {
  const dots = header.points.map(({ name, region }, i) => {
    const group = svg.appendChild(document.createElementNS(SVG, "g"));
    const [line, end, grip, dot] = ["line", "circle", "circle", "circle"].map((kind) =>
      group.appendChild(document.createElementNS(SVG, kind)));
    const words = `${spaced(name)} (${spaced(region)})`;
    group.appendChild(document.createElementNS(SVG, "title")).textContent = words;
    group.setAttribute("class", "point");
    group.setAttribute("tabindex", "0");
    group.setAttribute("role", "button");
    group.setAttribute("aria-label", `control point ${words}; arrow keys move it`);
    grip.setAttribute("class", "grip");
    grip.setAttribute("r", GRIP_PX);
    dot.setAttribute("class", "dot");
    dot.setAttribute("r", DOT_PX);
    end.setAttribute("class", "end");
    end.setAttribute("r", 2.5);
    const target = () => Array.from(pose.targets.subarray(3 * i, 3 * i + 3));

    let grasp = null; // from the pointer to the dot's middle, px: a dot that is touched at its edge doesn't jump
    group.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      const box = svg.getBoundingClientRect(), [left, top] = view.place(shown(i));
      grasp = { id: event.pointerId, x: left - (event.clientX - box.left), y: top - (event.clientY - box.top) };
      if (event.isTrusted) group.setPointerCapture(event.pointerId); // what a test makes up can't be captured
      group.classList.add("held");
      event.stopPropagation();
    });
    group.addEventListener("pointermove", (event) => {
      if (!grasp || event.pointerId !== grasp.id) return;
      const box = svg.getBoundingClientRect();
      const place = [event.clientX - box.left + grasp.x, event.clientY - box.top + grasp.y];
      drag(i, ...view.unproject(...place, target()[2]));
    });
    const release = (event) => {
      if (grasp && event.pointerId === grasp.id) grasp = null;
      group.classList.toggle("held", Boolean(grasp));
    };
    group.addEventListener("pointerup", release);
    group.addEventListener("pointercancel", release);
    group.addEventListener("keydown", (event) => {
      const step = KEYS[event.key];
      if (!step) return;
      const [x, y] = target(), size = KEY_MM * (event.shiftKey ? 5 : 1);
      drag(i, x + size * step[0], y + size * step[1]);
      event.preventDefault();
    });
    return { group, line, end, grip, dot };
  });

  const shown = (i) => Array.from(pose.targets.subarray(3 * i, 3 * i + 3));

  function update() {
    dots.forEach(({ line, end, grip, dot }, i) => {
      const [x, y] = view.place(shown(i)), [u, v] = view.place(pose.reached(i));
      for (const circle of [grip, dot]) place(circle, { cx: x, cy: y });
      place(end, { cx: u, cy: v });
      place(line, { x1: x, y1: y, x2: u, y2: v });
    });
  }
  return { update, dots };
}

function place(element, values) {
  for (const [name, value] of Object.entries(values)) element.setAttribute(name, value.toFixed(2));
}

function spaced(name) {
  return name.replaceAll("_", " ");
}
