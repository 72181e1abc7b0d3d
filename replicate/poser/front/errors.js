// The errors against the rig: colours on the skin, and a legend that says what they mean.

const KINDS_OF_ERROR = { normal: "angle of normals", distance: "distance" };
const WHERE = { whole: "on the whole face", half: "on the right half", nowhere: "not shown" };
const LEGEND = `
  <p><label>Error against the rig: <select name="kind"></select></label> <select name="where"></select></p>
  <div class="bar"></div><div class="ticks"></div>
  <p class="title"></p><p class="words" role="status"></p>`;

// Returns {show(errors, kind), wait()}. choose(kind): somebody wants to see another kind of error.
function createErrors(stage, { arrays }, view, redraw, choose) {
  const root = stage.appendChild(document.createElement("div"));
  root.className = "errors";
  root.innerHTML = LEGEND;
  const find = (selector) => root.querySelector(selector), { neutral } = arrays;
  const kind = fill(find("[name=kind]"), KINDS_OF_ERROR), where = fill(find("[name=where]"), WHERE);
  let latest = null;

  function paint() {
    const shown = { whole: () => true, half: (i) => neutral[3 * i] > 0, nowhere: () => false }[where.value];
    const colours = new Uint8Array((4 * neutral.length) / 3);
    for (let i = 0; i < neutral.length / 3; i++) {
      const isShown = latest && shown(i), own = isShown ? latest : arrays.paint;
      for (let a = 0; a < 3; a++) colours[4 * i + a] = own[3 * i + a];
      colours[4 * i + 3] = isShown ? UNLIT : 0;
    }
    view.paint(colours);
    redraw();
  }
  kind.addEventListener("change", () => choose(kind.value));
  where.addEventListener("change", paint);

  return {
    show(errors, chosen) {
      if (!errors.colours) return;
      const { buffer, byteOffset, byteLength } = errors.colours;
      latest = new Uint8Array(buffer, byteOffset, byteLength);
      kind.value = chosen;
      find(".bar").style.background = `linear-gradient(90deg, ${errors.bar.join(", ")})`;
      find(".ticks").replaceChildren(...errors.ticks.map(([share, text]) => {
        const tick = document.createElement("span");
        tick.style.left = `${100 * share}%`;
        tick.textContent = text;
        return tick;
      }));
      find(".title").textContent = errors.title;
      find(".words").textContent = errors.words;
      root.classList.remove("waiting");
      paint();
    },
    wait: () => root.classList.add("waiting"),
  };
}

function fill(select, choices) {
  for (const [value, text] of Object.entries(choices)) select.add(new Option(text, value));
  return select;
}
