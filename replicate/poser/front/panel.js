// The sliders of all rig parameters, group by group: they follow the points, and move the face by hand.

const SHOWN_MOVE = 0.005; // of a control's range: what counts as moved

// Returns {update}, which moves the sliders to the pose. changed(j, value): slider j was moved by hand.
function createPanel(root, { header, arrays }, pose, changed) {
  const { limits } = arrays, groups = new Map();
  const sliders = header.controls.map(({ name, region }, j) => {
    if (!groups.has(region)) groups.set(region, createGroup(root, region));
    const group = groups.get(region), [lower, usual, upper] = limits.subarray(3 * j, 3 * j + 3);
    const label = group.list.appendChild(document.createElement("label"));
    const words = label.appendChild(document.createElement("span"));
    words.textContent = label.title = spaced(name);
    const input = label.appendChild(document.createElement("input"));
    Object.assign(input, { type: "range", min: lower, max: upper, step: (upper - lower) / 1000, value: usual });
    const number = label.appendChild(document.createElement("output"));
    input.addEventListener("input", () => changed(j, Number(input.value)));
    label.addEventListener("dblclick", () => changed(j, usual));
    group.members.push(j);
    return { input, number, usual, range: upper - lower, value: NaN };
  });
  const isMoved = (j) => Math.abs(pose.params[j] - sliders[j].usual) > SHOWN_MOVE * sliders[j].range;

  function update() {
    for (const { details, members, count } of groups.values()) {
      const moved = members.filter(isMoved).length;
      count.textContent = moved ? `${moved} of ${members.length} moved` : `${members.length}`;
      details.classList.toggle("moved", moved > 0);
      if (!details.open) continue; // what nobody sees is moved when it is opened
      for (const j of members) {
        const slider = sliders[j], value = pose.params[j];
        if (slider.value === value) continue;
        slider.value = value;
        if (Number(slider.input.value) !== value) slider.input.value = value;
        slider.number.textContent = value.toFixed(2);
        slider.input.parentElement.classList.toggle("moved", isMoved(j));
      }
    }
  }
  for (const { details } of groups.values()) details.addEventListener("toggle", update);
  return { update, sliders, open: (region) => groups.has(region) && (groups.get(region).details.open = true) };
}

function createGroup(root, region) {
  const details = root.appendChild(document.createElement("details"));
  const summary = details.appendChild(document.createElement("summary"));
  summary.appendChild(document.createElement("b")).textContent = spaced(region);
  const count = summary.appendChild(document.createElement("span"));
  const list = details.appendChild(document.createElement("div"));
  return { details, count, list, members: [] };
}
