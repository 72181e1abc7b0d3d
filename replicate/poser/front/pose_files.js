// A pose as a file (JSON), and as the end of a link.

const POSE_FORMAT = "facial pose", POSE_VERSION = 1;
const LINK_STEPS = 32767; // of a control from one limit to the other
const LINK_MM = 0.01; // of a control point
const FARTHEST_MM = 1e4; // of a control point, in each direction

function poseText({ header }, pose) {
  const controls = Object.fromEntries(header.controls.map(({ name }, j) => [name, Number(pose.params[j].toFixed(6))]));
  const points = Object.fromEntries(header.points.map(({ name }, i) => [
    name, Array.from(pose.targets.subarray(3 * i, 3 * i + 3), (x) => Number(x.toFixed(4))),
  ]));
  const words = { format: POSE_FORMAT, version: POSE_VERSION, character: header.character, controls, points };
  return JSON.stringify(words, null, 1) + "\n";
}

// The text of a file → {params, targets}; targets is null where it has no points. Throws an Error that says what is
// wrong with it and what was expected.
function readPose({ header, arrays }, text) {
  let words;
  try {
    words = JSON.parse(text);
  } catch (error) {
    throw new Error(`this file is not JSON (${error.message})`);
  }
  if (!isTable(words) || words.format !== POSE_FORMAT || !isTable(words.controls)) {
    throw new Error(`this file is not a saved pose: expected a table with "format": "${POSE_FORMAT}" and "controls"`);
  }
  if (words.version !== POSE_VERSION) throw new Error(`expected a pose of version ${POSE_VERSION}, got ${words.version}`);
  if (words.character !== header.character) {
    throw new Error(`this pose is of the character ${words.character}, and the face here is ${header.character}`);
  }
  const params = header.controls.map(() => NaN);
  for (const [name, value] of Object.entries(words.controls)) {
    const j = header.controls.findIndex((control) => control.name === name);
    if (j < 0) throw new Error(`${header.character} has no control "${name}"`);
    const [lower, , upper] = arrays.limits.subarray(3 * j, 3 * j + 3);
    if (!(typeof value === "number" && value >= lower - 1e-4 && value <= upper + 1e-4)) {
      throw new Error(`control "${name}": expected a number from ${lower} to ${upper}, got ${JSON.stringify(value)}`);
    }
    params[j] = value;
  }
  const missing = params.findIndex(Number.isNaN);
  if (missing >= 0) throw new Error(`control "${header.controls[missing].name}": expected a value, got none`);
  if (words.points === undefined) return { params, targets: null };
  const targets = new Float32Array(3 * header.points.length);
  header.points.forEach(({ name }, i) => {
    const place = isTable(words.points) ? words.points[name] : undefined;
    if (!(Array.isArray(place) && place.length === 3 && place.every(isLength))) {
      throw new Error(`control point "${name}": expected three lengths from ${-FARTHEST_MM} to ${FARTHEST_MM} mm, got ${JSON.stringify(place)}`);
    }
    targets.set(place, 3 * i);
  });
  return { params, targets };
}

function isLength(value) {
  return typeof value === "number" && Math.abs(value) <= FARTHEST_MM;
}

function isTable(value) {
  return typeof value === "object" && value !== null && !Array.isArray(value);
}

// What a link ends with: the character, a dot, and whole numbers of 16 bits in base64.
function poseLink({ header, arrays }, pose) {
  const m = header.controls.length, c = header.points.length, values = new DataView(new ArrayBuffer(2 * (m + 3 * c)));
  for (let j = 0; j < m; j++) {
    const [lower, , upper] = arrays.limits.subarray(3 * j, 3 * j + 3);
    values.setInt16(2 * j, Math.round((LINK_STEPS * (pose.params[j] - lower)) / (upper - lower)), true);
  }
  for (let i = 0; i < 3 * c; i++) {
    const moved = (pose.targets[i] - arrays.neutral[3 * arrays.points[Math.floor(i / 3)] + (i % 3)]) / LINK_MM;
    values.setInt16(2 * (m + i), Math.max(-LINK_STEPS, Math.min(LINK_STEPS, Math.round(moved))), true);
  }
  const plain = String.fromCharCode(...new Uint8Array(values.buffer));
  const text = btoa(plain).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
  return `${encodeURIComponent(header.character)}.${text}`;
}

// The end of a link → {params, targets}. Throws an Error where it is of no pose of this character.
function readLink({ header, arrays }, link) {
  const m = header.controls.length, c = header.points.length, dot = link.lastIndexOf(".");
  let plain = "";
  try {
    if (decodeURIComponent(link.slice(0, dot)) === header.character) {
      plain = atob(link.slice(dot + 1).replaceAll("-", "+").replaceAll("_", "/"));
    }
  } catch {
    // what can't be decoded is of no pose
  }
  if (plain.length !== 2 * (m + 3 * c)) throw new Error(`this link is not a pose of ${header.character}; the face is at rest`);
  const values = new DataView(Uint8Array.from(plain, (letter) => letter.charCodeAt(0)).buffer);
  const params = header.controls.map((_, j) => {
    const [lower, middle, upper] = arrays.limits.subarray(3 * j, 3 * j + 3), step = (upper - lower) / LINK_STEPS;
    const value = lower + step * values.getInt16(2 * j, true);
    return Math.abs(value - middle) < step ? middle : value;
  });
  const targets = Float32Array.from({ length: 3 * c }, (_, i) => {
    const rest = arrays.neutral[3 * arrays.points[Math.floor(i / 3)] + (i % 3)];
    return rest + LINK_MM * values.getInt16(2 * (m + i), true);
  });
  return { params, targets };
}
