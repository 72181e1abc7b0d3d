// What the page says of itself: its arithmetic against Python's, and its ways of working, tried out.

// mounted: what mountPoser returns → a table of results.
function selfTest(mounted) {
  const { packed, pose, view, points, panel, load, draw, status, svg } = mounted;
  const { header, arrays } = packed, m = header.controls.length, c = header.points.length;
  const solve = inverseModel(packed), shown = arrays["check.shown"];
  const result = { vertices_mm: 0, parameters: 0, poses: header.checks };
  for (let b = 0; b < header.checks; b++) {
    pose.set(arrays["check.params"].subarray(b * m, (b + 1) * m));
    const wanted = arrays["check.vertices"].subarray(3 * b * shown.length, 3 * (b + 1) * shown.length);
    shown.forEach((v, i) => {
      for (let a = 0; a < 3; a++) {
        const apart = Math.abs(pose.vertices[3 * v + a] - wanted[3 * i + a]);
        result.vertices_mm = apart <= result.vertices_mm ? result.vertices_mm : apart; // NaN stays
      }
    });
    const said = solve(arrays["check.targets"].subarray(3 * b * c, 3 * (b + 1) * c));
    for (let j = 0; j < m; j++) {
      const range = arrays.limits[3 * j + 2] - arrays.limits[3 * j];
      const apart = Math.abs(said[j] - arrays["check.solved"][b * m + j]) / range;
      result.parameters = apart <= result.parameters ? result.parameters : apart;
    }
  }
  const moved = (from) => Array.from(pose.params, (p, j) => [p !== from[j], header.controls[j].name]).filter(([x]) => x);
  const rest = () => {
    pose.reset();
    draw();
    return Float32Array.from(pose.params);
  };

  result.drags = header.inverse.regions.map((region) => {
    const from = rest(), i = region.points[0], before = Array.from(pose.targets.subarray(3 * i, 3 * i + 3));
    const was = pose.reached(i);
    const start = view.place(before), aim = view.place([before[0] + 2, before[1] - 3, before[2]]);
    pull(svg, points.dots[i].group, start, aim);
    draw();
    const now = pose.reached(i), [dot] = [points.dots[i].dot];
    return {
      point: header.points[i].name, region: region.name, moved: moved(from).map(([, name]) => name),
      allowed: region.parameters.map((j) => header.controls[j].name),
      target_mm: [0, 1, 2].map((a) => pose.targets[3 * i + a] - before[a]),
      reached_mm: [0, 1, 2].map((a) => now[a] - was[a]),
      dot_px: [Number(dot.getAttribute("cx")) - aim[0], Number(dot.getAttribute("cy")) - aim[1]],
    };
  });

  const from = rest(), slider = panel.sliders[0], middle = (Number(slider.input.max) + slider.usual) / 2;
  slider.input.value = middle;
  slider.input.dispatchEvent(new Event("input"));
  const apart = header.points.map((_, i) => Math.hypot(...pose.reached(i).map((x, a) => x - pose.targets[3 * i + a])));
  result.slider = { moved: moved(from).map(([, name]) => name), wanted: middle, value: pose.params[0], apart_mm: Math.max(...apart) };

  const params = Float32Array.from(pose.params), [first] = pose.targets;
  const text = poseText(packed, pose), link = poseLink(packed, pose);
  const back = (read) => {
    rest();
    const worked = load(read);
    return worked ? Math.max(...params.map((p, j) => Math.abs(p - pose.params[j])), Math.abs(first - pose.targets[0])) : NaN;
  };
  result.file = back(() => readPose(packed, text));
  result.link = back(() => readLink(packed, link));
  const table = JSON.parse(text), [name] = Object.keys(table.controls);
  const bad = {
    letters: "no json", list: "[]", stranger: JSON.stringify({ ...table, character: "nobody" }),
    control: JSON.stringify({ ...table, controls: { nose_length: 1 } }),
    value: JSON.stringify({ ...table, controls: { ...table.controls, [name]: 99 } }),
    none: JSON.stringify({ ...table, controls: { ...table.controls, [name]: undefined } }), point: JSON.stringify({ ...table, points: {} }),
    far: JSON.stringify({ ...table, points: { ...table.points, [header.points[0].name]: [0, 1e39, 0] } }),
  };
  result.refused = Object.fromEntries(Object.entries(bad).map(([key, words]) => {
    const before = Float32Array.from(pose.params), worked = load(() => readPose(packed, words));
    return [key, !worked && before.every((p, j) => p === pose.params[j]) ? status.textContent : null];
  }));
  load(() => readLink(packed, "nobody.AAAA"));
  result.refused.link = status.textContent;

  rest();
  const times = Array.from({ length: 40 }, (_, k) => {
    const start = performance.now();
    pose.drag(0, pose.targets[0] + (k % 2 ? 1 : -1), pose.targets[1]);
    draw();
    return performance.now() - start;
  });
  result.update_ms = times.sort((a, b) => a - b)[20];
  rest();
  load(() => ({ params, targets: null }));
  return result;
}

// A drag of the mouse, as the browser would report it.
function pull(svg, element, [x, y], [u, v]) {
  const box = svg.getBoundingClientRect();
  const send = (kind, left, top) => element.dispatchEvent(new PointerEvent(kind, {
    pointerId: 1, button: 0, clientX: box.left + left, clientY: box.top + top, bubbles: true,
  }));
  send("pointerdown", x + 2, y + 1); // not in its middle
  send("pointermove", (x + u) / 2, (y + v) / 2);
  send("pointermove", u + 2, v + 1);
  send("pointerup", u + 2, v + 1);
}
