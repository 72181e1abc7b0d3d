// The picture: WebGL 2, an orthographic camera that looks along −z, and lights that are fixed to it.
//
// With a graphics card each pixel is lit. Without one the processor draws, for which that is several times too much: there
// each vertex is lit, and edges are not smoothed.

const SHADING = `
uniform vec3 from[LIGHTS]; uniform vec4 light[LIGHTS]; uniform float ambient; uniform vec2 finishes[FINISHES];
vec3 lit(vec3 u, vec3 colour, int finish) {
  if (finish == UNLIT) return colour;
  vec3 sum = vec3(ambient), glint = vec3(0.0);
  for (int i = 0; i < LIGHTS; i++) {
    sum += light[i].rgb * light[i].a * max(dot(u, from[i]), 0.0);
    float mirrored = max(reflect(-from[i], u).z, 0.0);
    glint += light[i].rgb * light[i].a * finishes[finish].x * pow(mirrored, finishes[finish].y);
  }
  return colour * sum + glint;
}`;
const VERTEX_SHADER = `#version 300 es
in vec3 position; in vec3 normal; in vec4 paint;
uniform mat3 turn; uniform vec3 centre; uniform vec2 scale; uniform vec2 shift; uniform float depth;
out vec3 n; out vec3 colour; flat out int finish;
#ifdef BY_VERTEX
${SHADING}
#endif
void main() {
  vec3 p = turn * (position - centre);
  gl_Position = vec4((p.xy - shift) * scale, -p.z / depth, 1.0);
  n = turn * normal;
  finish = int(paint.a * 255.0 + 0.5);
#ifdef BY_VERTEX
  vec3 u = normalize(n);
  colour = lit(vec3(u.xy, abs(u.z)), paint.rgb, finish); // from either side
#else
  colour = paint.rgb;
#endif
}`;
const FRAGMENT_SHADER = `#version 300 es
precision highp float;
in vec3 n; in vec3 colour; flat in int finish;
out vec4 seen;
#ifndef BY_VERTEX
${SHADING}
#endif
void main() {
#ifdef BY_VERTEX
  seen = vec4(colour, 1.0);
#else
  vec3 u = normalize(n);
  if (!gl_FrontFacing && u.z < 0.0) u = -u; // a surface that is seen from behind
  seen = vec4(lit(u, colour, finish), 1.0);
#endif
}`;
const MATT = [0.1, 24];
const UNLIT = 255; // in the place of a finish: a colour that means something and is not shaded
const MARGIN = 1.06; // of the head's size, so that it doesn't touch the frame
const MOST_TURN = 1.1; // radians to a side: further round a point couldn't be dragged in x and y
const ZOOM = [0.6, 12];

// canvas, packed, display (see displayModel) → the view. Throws an Error where there is no WebGL 2.
function createView(canvas, { header, arrays }, display) {
  const card = hasGraphicsCard();
  const gl = canvas.getContext("webgl2", { antialias: card, alpha: true, premultipliedAlpha: false });
  if (!gl) throw new Error("this browser shows no WebGL 2, which the picture needs: allow graphics, or try another one");
  const finishes = [MATT, ...(display ? display.finishes : [])];
  const program = makeProgram(gl, header.lights.length, finishes.length, !card);
  const at = (name) => gl.getUniformLocation(program, name);
  const skinPaint = new Uint8Array((arrays.neutral.length / 3) * 4);
  for (let i = 0; i < skinPaint.length / 4; i++) skinPaint.set(arrays.paint.subarray(3 * i, 3 * i + 3), 4 * i);
  const meshes = [makeMesh(gl, program, arrays.faces, arrays.neutral, skinPaint)];
  if (display) {
    const paint = Uint8Array.from(display.paint, (x, i) => (i % 4 === 3 ? x + 1 : x));
    meshes.push(makeMesh(gl, program, display.faces, display.rest, paint));
  }
  const box = bounds(arrays.neutral, display);
  const centre = box.map(([low, high]) => (low + high) / 2);
  const view = { yaw: 0, pitch: 0, zoom: 1, shift: [0, 0], matrix: turnMatrix(0, 0) };

  gl.useProgram(program);
  header.lights.forEach(([x, y, z, strength, r, g, b], i) => {
    const length = Math.hypot(x, y, z);
    gl.uniform3f(at(`from[${i}]`), x / length, y / length, z / length);
    gl.uniform4f(at(`light[${i}]`), r, g, b, strength);
  });
  gl.uniform1f(at("ambient"), header.ambient);
  gl.uniform2fv(at("finishes"), finishes.flat());
  gl.uniform3fv(at("centre"), centre);
  gl.uniform1f(at("depth"), 2 * Math.max(...box.map(([low, high]) => high - low)));

  // Half of what is seen, in mm: across, up.
  function halves() {
    const [width, height] = [0, 1].map((a) => (box[a][1] - box[a][0]) * MARGIN);
    const aspect = canvas.clientWidth / Math.max(canvas.clientHeight, 1);
    const up = Math.max(height, width / aspect) / 2 / view.zoom;
    return [up * aspect, up];
  }

  return {
    view,
    card,
    draw(vertices, normals, displayVertices, displayNormals) {
      const ratio = window.devicePixelRatio || 1;
      const size = [canvas.clientWidth, canvas.clientHeight].map((x) => Math.max(1, Math.round(x * ratio)));
      if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
      const [across, up] = halves();
      gl.viewport(0, 0, canvas.width, canvas.height);
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
      gl.enable(gl.DEPTH_TEST);
      gl.useProgram(program);
      gl.uniformMatrix3fv(at("turn"), true, view.matrix);
      gl.uniform2f(at("scale"), 1 / across, 1 / up);
      gl.uniform2fv(at("shift"), view.shift);
      drawMesh(gl, meshes[0], vertices, normals);
      if (display) drawMesh(gl, meshes[1], displayVertices, displayNormals);
    },
    // Paints the skin: red, green, blue and finish of each vertex, or UNLIT; null for its own colours.
    paint(colours) {
      gl.bindBuffer(gl.ARRAY_BUFFER, meshes[0].paint);
      gl.bufferSubData(gl.ARRAY_BUFFER, 0, colours || skinPaint);
    },
    close() {
      gl.getExtension("WEBGL_lose_context")?.loseContext(); // a browser has only a few of them
    },
    // A point in mm → its place in the canvas, in CSS pixels.
    place([x, y, z]) {
      const p = [x - centre[0], y - centre[1], z - centre[2]], m = view.matrix, [across, up] = halves();
      const u = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] - view.shift[0];
      const v = m[3] * p[0] + m[4] * p[1] + m[5] * p[2] - view.shift[1];
      return [(u / across + 1) * canvas.clientWidth / 2, (1 - v / up) * canvas.clientHeight / 2];
    },
    // A place in CSS pixels → x and y, in mm, of the point there whose depth is z.
    unproject(left, top, z) {
      const m = view.matrix, [across, up] = halves(), d = z - centre[2];
      const u = ((2 * left) / canvas.clientWidth - 1) * across + view.shift[0] - m[2] * d;
      const v = (1 - (2 * top) / canvas.clientHeight) * up + view.shift[1] - m[5] * d;
      const area = m[0] * m[4] - m[1] * m[3];
      return [(u * m[4] - v * m[1]) / area + centre[0], (v * m[0] - u * m[3]) / area + centre[1]];
    },
    turnBy(yaw, pitch) {
      view.yaw = Math.max(-MOST_TURN, Math.min(MOST_TURN, view.yaw + yaw));
      view.pitch = Math.max(-MOST_TURN / 2, Math.min(MOST_TURN / 2, view.pitch + pitch));
      view.matrix = turnMatrix(view.yaw, view.pitch);
    },
    // Zooms about a place in CSS pixels, which stays where it is.
    zoomBy(factor, left, top) {
      const before = halves(), zoom = Math.max(ZOOM[0], Math.min(ZOOM[1], view.zoom * factor));
      view.zoom = zoom;
      const after = halves();
      view.shift[0] += ((2 * left) / canvas.clientWidth - 1) * (before[0] - after[0]);
      view.shift[1] += (1 - (2 * top) / canvas.clientHeight) * (before[1] - after[1]);
    },
    front() {
      Object.assign(view, { yaw: 0, pitch: 0, zoom: 1, shift: [0, 0], matrix: turnMatrix(0, 0) });
    },
  };
}

// The rotation of column vectors, row by row: about y, then about x.
function turnMatrix(yaw, pitch) {
  const c = Math.cos(yaw), s = Math.sin(yaw), d = Math.cos(pitch), e = Math.sin(pitch);
  return [c, 0, s, e * s, d, -e * c, -d * s, e, d * c];
}

// The lowest and highest x, y and z of the head and of those meshes for display that count.
function bounds(neutral, display) {
  const box = [[Infinity, -Infinity], [Infinity, -Infinity], [Infinity, -Infinity]];
  const add = (points, first, last) => {
    for (let i = 3 * first; i < 3 * last; i++) {
      box[i % 3][0] = Math.min(box[i % 3][0], points[i]);
      box[i % 3][1] = Math.max(box[i % 3][1], points[i]);
    }
  };
  add(neutral, 0, neutral.length / 3);
  if (display) for (const [first, last] of display.framed) add(display.rest, first, last);
  return box;
}

// Whether something other than the processor draws, as far as the browser says.
function hasGraphicsCard() {
  const gl = document.createElement("canvas").getContext("webgl2", { failIfMajorPerformanceCaveat: true });
  if (!gl) return false;
  const told = gl.getExtension("WEBGL_debug_renderer_info");
  const name = String(gl.getParameter(told ? told.UNMASKED_RENDERER_WEBGL : gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return !/SwiftShader|llvmpipe|Microsoft Basic Render|software/i.test(name);
}

// byVertex: whether vertices are lit, in the place of pixels.
function makeProgram(gl, lights, finishes, byVertex) {
  const program = gl.createProgram();
  const constants = { LIGHTS: lights, FINISHES: finishes, UNLIT, ...(byVertex ? { BY_VERTEX: 1 } : {}) };
  const defined = Object.entries(constants).map(([name, value]) => `#define ${name} ${value}\n`).join("");
  for (const [kind, text] of [[gl.VERTEX_SHADER, VERTEX_SHADER], [gl.FRAGMENT_SHADER, FRAGMENT_SHADER]]) {
    const shader = gl.createShader(kind), [version, ...rest] = text.split("\n");
    gl.shaderSource(shader, [version, defined + rest.join("\n")].join("\n"));
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}

function makeMesh(gl, program, faces, vertices, paint) {
  const array = gl.createVertexArray(), moving = {};
  gl.bindVertexArray(array);
  const attribute = (name, data, use, size, kind, normalised) => {
    const buffer = gl.createBuffer(), place = gl.getAttribLocation(program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, data, use);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, kind, normalised, 0, 0);
    return buffer;
  };
  moving.position = attribute("position", vertices, gl.DYNAMIC_DRAW, 3, gl.FLOAT, false);
  moving.normal = attribute("normal", new Float32Array(vertices.length), gl.DYNAMIC_DRAW, 3, gl.FLOAT, false);
  moving.paint = attribute("paint", paint, gl.DYNAMIC_DRAW, 4, gl.UNSIGNED_BYTE, true);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, faces, gl.STATIC_DRAW);
  gl.bindVertexArray(null);
  const kind = faces instanceof Uint16Array ? gl.UNSIGNED_SHORT : gl.UNSIGNED_INT;
  return { array, count: faces.length, kind, ...moving };
}

function drawMesh(gl, mesh, vertices, normals) {
  for (const [buffer, data] of [[mesh.position, vertices], [mesh.normal, normals]]) {
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, data);
  }
  gl.bindVertexArray(mesh.array);
  gl.drawElements(gl.TRIANGLES, mesh.count, mesh.kind, 0);
  gl.bindVertexArray(null);
}
