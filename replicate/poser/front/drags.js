// Configurations of control points as CSV: the format of data_recipes/drags, which `make table4` reads.

const DRAGS_HEADER = "configuration,point,x_mm,y_mm";
const DRAG_STEPS = 100; // a mm

// packed, pose → [point's name, x, y] of each control point that is wanted elsewhere than at rest: how far, in mm.
function dragsOf({ header }, { targets, rest }) {
  const move = (k) => Math.round(DRAG_STEPS * (targets[k] - rest[k])) / DRAG_STEPS;
  const drags = header.points.map(({ name }, i) => [name, move(3 * i), move(3 * i + 1)]);
  return drags.filter(([, x, y]) => x || y).sort(([a], [b]) => (a < b ? -1 : 1));
}

// Configurations, as `dragsOf` gives each, → the text of a file; they are numbered from 1.
function dragsText(configurations) {
  const lines = configurations.flatMap((drags, k) => drags.map(([name, x, y]) => `${k + 1},${name},${x},${y}`));
  return [DRAGS_HEADER, ...lines, ""].join("\n");
}
