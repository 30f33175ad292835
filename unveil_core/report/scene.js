"use strict";
// The empty scene to turn: flat Gaussian splats by WebGL 2, each pixel by the mathematics of unveil_core/raster/spec.py.
(() => {
  const box = document.getElementById("scene-view");
  const data = document.getElementById("scene");
  if (!box || !data) return;
  const part = (name) => box.querySelector(name);
  const [canvas, note, controls, scrub, play, count] = ["canvas", ".note", ".controls", ".scrub", ".play", ".count"].map(part);
  const NEAR = 0.2; // metres: nearer splats are not drawn, as in the rasterizer
  const COLUMNS = 1024; // splats in a row of the texture, two texels each
  const AHEAD = 8; // metres from a camera of the drive to the place that is turned about
  const STEPS = 65536; // of depth, by which splats are sorted
  const SPEED = 8; // metres a second along the drive

  const SPLAT_VERTEX = `#version 300 es
    precision highp float; precision highp int; precision highp usampler2D;
    uniform usampler2D words; uniform mat3 turn; uniform vec3 eye, low; uniform float stride, focal; uniform vec2 size, logs;
    uniform bool marked; uniform vec4 tints[5];
    layout(location = 0) in uint index;
    flat out vec4 color; flat out vec3 rowU, rowV; flat out vec3 middle;
    const float NEAR = ${NEAR};
    void main() {
      gl_Position = vec4(2.0, 2.0, 2.0, 1.0); // nowhere
      ivec2 cell = ivec2(int(index % ${COLUMNS}u) * 2, int(index / ${COLUMNS}u));
      uvec4 a = texelFetch(words, cell, 0);
      uint b = texelFetch(words, cell + ivec2(1, 0), 0).r;
      uvec3 steps = uvec3(a.r & 0x1FFFFFu, (a.r >> 21) | ((a.g & 0x3FFu) << 11), (a.g >> 10) & 0x1FFFFFu);
      vec3 p = turn * (low - eye + stride * vec3(steps));
      float opacity = float(a.a >> 24) / 255.0;
      if (p.z < NEAR || opacity < 1.0 / 255.0) return;

      vec4 q = vec4(0.0); // x y z w; the largest is what is left of one
      int largest = int(a.b >> 30);
      uint rest = a.b;
      for (int i = 3; i >= 0; i--) {
        if (i == largest) continue;
        float value = float(rest & 511u) / 511.0 * 0.70710678;
        q[i] = (rest & 512u) != 0u ? -value : value;
        rest >>= 10;
      }
      q[largest] = sqrt(max(0.0, 1.0 - dot(q, q)));
      vec2 scales = exp(logs.x + (logs.y - logs.x) * vec2(b & 0x3FFFu, (b >> 14) & 0x3FFFu) / 16383.0);
      vec3 hu = turn * vec3(1.0 - 2.0 * (q.y * q.y + q.z * q.z), 2.0 * (q.x * q.y + q.w * q.z), 2.0 * (q.x * q.z - q.w * q.y)) * scales.x;
      vec3 hv = turn * vec3(2.0 * (q.x * q.y - q.w * q.z), 1.0 - 2.0 * (q.x * q.x + q.z * q.z), 2.0 * (q.y * q.z + q.w * q.x)) * scales.y;

      // Nothing of it is seen where its sphere lies beside the picture; the blur is a few pixels more.
      float reach = 2.0 * log(255.0 * opacity); // squared
      vec2 half_ = 0.5 * size + 3.0;
      vec2 inside = (half_ * p.z - focal * abs(p.xy)) / sqrt(focal * focal + half_ * half_);
      if (min(inside.x, inside.y) < -sqrt(reach) * max(scales.x, scales.y)) return;

      vec2 c = p.xy / p.z;
      vec2 ju = focal * (hu.xy - c * hu.z), jv = focal * (hv.xy - c * hv.z);
      float det = ju.x * jv.y - jv.x * ju.y;
      float sine = abs(dot(cross(hu, hv), p)) / (scales.x * scales.y * length(p));
      rowU = rowV = vec3(0.0);
      if (sine > 1e-4) {
        vec2 u = vec2(jv.y, -jv.x) * (p.z / det), v = vec2(-ju.y, ju.x) * (p.z / det);
        rowU = vec3(u, 0.0);
        rowV = vec3(v, 1.0);
        vec2 slope = -(hu.z * u + hv.z * v) / p.z;
        rowU.z = slope.x;
        rowV.z = slope.y;
      }
      // The box around the ellipse, along its own axes on the screen, and around the low-pass filter.
      float blur = sqrt(0.5 * reach);
      vec2 at = 0.5 * size + focal * c, side = vec2(1.0, 0.0), from = -at, to = size - at; // the screen
      vec2 hz = vec2(hu.z, hv.z), jx = vec2(ju.x, jv.x), jy = vec2(ju.y, jv.y);
      float behind = reach * dot(hz, hz) - p.z * p.z;
      if (behind < 0.0) { // else it reaches behind the camera, and may be anywhere on the screen
        float angle = 0.5 * atan(2.0 * dot(jx, jy), dot(jx, jx) - dot(jy, jy));
        side = vec2(cos(angle), sin(angle));
        vec2 along = side.x * jx + side.y * jy, across = side.x * jy - side.y * jx;
        vec2 centre = reach * vec2(dot(along, hz), dot(across, hz)) / behind;
        vec2 extent = sqrt(max(vec2(0.0), centre * centre - reach * vec2(dot(along, along), dot(across, across)) / behind));
        from = min(centre - extent, -blur);
        to = max(centre + extent, blur);
      }
      middle = vec3(at, sine > 1e-4 ? p.z : -1.0);
      vec3 rgb = vec3(a.a & 255u, (a.a >> 8) & 255u, (a.a >> 16) & 255u) / 255.0;
      if (marked) {
        vec4 tint = tints[min(int(b >> 28), 4)];
        float grey = dot(rgb, vec3(1.0 / 3.0));
        rgb = tint.a > 0.0 ? 0.7 * tint.rgb + 0.3 * grey : 0.55 * rgb;
      }
      color = vec4(rgb, opacity);
      vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
      vec2 d = mix(from, to, corner);
      gl_Position = vec4((at + d.x * side + d.y * vec2(-side.y, side.x)) / size * 2.0 - 1.0, 0.0, 1.0);
    }`;
  const SPLAT_FRAGMENT = `#version 300 es
    precision highp float;
    flat in vec4 color; flat in vec3 rowU, rowV; flat in vec3 middle;
    out vec4 shown;
    void main() {
      vec2 d = gl_FragCoord.xy - middle.xy;
      float distance_ = 2.0 * dot(d, d); // the low-pass filter of the screen
      float q = 1.0 + rowU.z * d.x + rowV.z * d.y;
      if (middle.z > 0.0 && q > 0.0 && q * ${NEAR} < middle.z) {
        vec2 uv = vec2(dot(rowU.xy, d), dot(rowV.xy, d)) / q;
        distance_ = min(distance_, dot(uv, uv));
      }
      float alpha = min(0.99, color.a * exp(-0.5 * distance_));
      if (alpha < 1.0 / 255.0) discard;
      shown = vec4(color.rgb * alpha, alpha);
    }`;
  const SKY_VERTEX = `#version 300 es
    void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
  const SKY_FRAGMENT = `#version 300 es
    precision highp float;
    uniform sampler2D panorama; uniform mat3 turn, axes; uniform vec2 size; uniform float focal; uniform bool marked;
    out vec4 shown;
    void main() {
      vec3 way = axes * (vec3((gl_FragCoord.xy - 0.5 * size) / focal, 1.0) * turn);
      vec2 at = vec2(atan(way.y, way.x) / 6.2831853, atan(way.z, length(way.xy)) / 3.1415927) + 0.5;
      shown = vec4(texture(panorama, at).rgb * (marked ? 0.55 : 1.0), 1.0);
    }`;

  const bytesOf = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  let scene, places, depth, order, counts, gl, drawing;
  let view = { target: [0, 0, 0], distance: AHEAD, yaw: 0, pitch: 0 };
  let marked = false, playing = 0, asked = 0, sorted = "", sharpness = 1, slow = 0, last = 0, rest = 0;

  const tell = (words) => {
    note.textContent = words;
    note.hidden = false;
    canvas.hidden = controls.hidden = true;
  };

  // Reading ------------------------------------------------------------------------------------------------------------
  const read = () => {
    scene = JSON.parse(data.textContent);
    scene.words = new Uint32Array(bytesOf(scene.splats).buffer);
    scene.splats = "";
    const n = scene.count, words = scene.words, [x, y, z] = scene.low;
    places = new Float32Array(3 * n);
    for (let i = 0; i < n; i++) {
      const a = words[5 * i], b = words[5 * i + 1];
      places[3 * i] = x + scene.step * (a & 0x1fffff);
      places[3 * i + 1] = y + scene.step * ((a >>> 21) | ((b & 0x3ff) << 11));
      places[3 * i + 2] = z + scene.step * ((b >>> 10) & 0x1fffff);
    }
    depth = new Float32Array(n);
    order = new Uint32Array(n);
    counts = new Uint32Array(STEPS);
  };

  // Drawing ------------------------------------------------------------------------------------------------------------
  const program = (vertex, fragment) => {
    const made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(made, shader);
    }
    gl.linkProgram(made);
    if (!gl.getProgramParameter(made, gl.LINK_STATUS) && !gl.isContextLost()) throw new Error(gl.getProgramInfoLog(made));
    return { made, at: (name) => gl.getUniformLocation(made, name) };
  };
  const texture = (unit, kind, inner, format, type, width, height, values) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, inner, width, height, 0, format, type, values);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, kind);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, kind);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  };
  const prepare = () => {
    const rows = Math.max(1, Math.ceil(scene.count / COLUMNS));
    const texels = new Uint32Array(8 * COLUMNS * rows);
    for (let i = 0; i < scene.count; i++) for (let k = 0; k < 5; k++) texels[8 * i + k] = scene.words[5 * i + k];
    texture(0, gl.NEAREST, gl.RGBA32UI, gl.RGBA_INTEGER, gl.UNSIGNED_INT, 2 * COLUMNS, rows, texels);
    const sky = scene.sky;
    texture(1, gl.LINEAR, gl.RGB8, gl.RGB, gl.UNSIGNED_BYTE, sky.width, sky.height, bytesOf(sky.colors));
    const splats = program(SPLAT_VERTEX, SPLAT_FRAGMENT), behind = program(SKY_VERTEX, SKY_FRAGMENT);
    const list = gl.createBuffer(), withList = gl.createVertexArray(), without = gl.createVertexArray();
    gl.bindVertexArray(withList);
    gl.bindBuffer(gl.ARRAY_BUFFER, list);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribIPointer(0, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(0, 1);
    gl.useProgram(splats.made);
    gl.uniform1i(splats.at("words"), 0);
    gl.uniform3fv(splats.at("low"), scene.low);
    gl.uniform1f(splats.at("stride"), scene.step);
    gl.uniform2fv(splats.at("logs"), scene.logs);
    gl.uniform4fv(splats.at("tints"), scene.tints.flat());
    gl.useProgram(behind.made);
    gl.uniform1i(behind.at("panorama"), 1);
    gl.uniformMatrix3fv(behind.at("axes"), true, sky.axes.flat());
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    drawing = { splats, behind, withList, without, number: 0 };
    sorted = "";
  };

  const axes = () => {
    const [cy, sy, cp, sp] = [Math.cos(view.yaw), Math.sin(view.yaw), Math.cos(view.pitch), Math.sin(view.pitch)];
    const forward = [cp * cy, cp * sy, sp];
    const up = [-sp * cy, -sp * sy, cp];
    return { right: [sy, -cy, 0], up, forward, eye: view.target.map((v, k) => v - view.distance * forward[k]) };
  };

  // From the farthest to the nearest, by a counting sort: some milliseconds for all splats of a page, so it needs no worker.
  const sort = (eye, [fx, fy, fz]) => {
    const n = scene.count, off = eye[0] * fx + eye[1] * fy + eye[2] * fz;
    let far = NEAR;
    for (let i = 0, k = 0; i < n; i++, k += 3) {
      const d = places[k] * fx + places[k + 1] * fy + places[k + 2] * fz - off;
      depth[i] = d;
      if (d > far) far = d;
    }
    const scale = (STEPS - 1) / Math.max(far - NEAR, 1e-6);
    counts.fill(0);
    for (let i = 0; i < n; i++) if (depth[i] >= NEAR) counts[((depth[i] - NEAR) * scale) | 0]++;
    let before = 0;
    for (let k = STEPS - 1; k >= 0; k--) {
      const here = counts[k];
      counts[k] = before;
      before += here;
    }
    // Of equal ones the first is the nearest, as in the rasterizer.
    for (let i = n - 1; i >= 0; i--) if (depth[i] >= NEAR) order[counts[((depth[i] - NEAR) * scale) | 0]++] = i;
    return before;
  };

  const draw = (moving) => {
    const ratio = Math.min(window.devicePixelRatio || 1, 2) * (moving ? sharpness : 1);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((v) => Math.max(1, Math.round(v * ratio)));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const { right, up, forward, eye } = axes();
    const turn = [0, 1, 2].flatMap((k) => [right[k], up[k], forward[k]]);
    const focal = (0.5 * width) / Math.tan(0.5 * scene.field);
    const place = [...eye, ...forward].join();
    if (place !== sorted) {
      drawing.number = sort(eye, forward);
      gl.bufferData(gl.ARRAY_BUFFER, order.subarray(0, drawing.number), gl.DYNAMIC_DRAW);
      sorted = place;
    }
    gl.viewport(0, 0, width, height);
    for (const one of [drawing.behind, drawing.splats]) {
      gl.useProgram(one.made);
      gl.uniformMatrix3fv(one.at("turn"), false, turn);
      gl.uniform2f(one.at("size"), width, height);
      gl.uniform1f(one.at("focal"), focal);
      gl.uniform1i(one.at("marked"), marked);
      if (one === drawing.behind) {
        gl.disable(gl.BLEND);
        gl.bindVertexArray(drawing.without);
        gl.drawArrays(gl.TRIANGLES, 0, 3);
      } else {
        gl.enable(gl.BLEND);
        gl.uniform3fv(one.at("eye"), eye);
        gl.bindVertexArray(drawing.withList);
        gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, drawing.number);
      }
    }
    canvas.dataset.view = JSON.stringify({ eye, forward, focal, width, height });
  };

  // Where graphics are slow the picture is coarser while it moves, and sharp again when it rests.
  const frame = (now) => {
    asked = 0;
    const took = now - last;
    last = now;
    if (took < 1000) {
      slow = took > 45 ? slow + 1 : Math.max(0, slow - 1);
      if (slow > 3) [sharpness, slow] = [Math.max(0.35, 0.75 * sharpness), 0];
    }
    if (playing) {
      along(+scrub.value + (SPEED * Math.min(took, 200)) / 1000 / scene.apart);
      if (+scrub.value >= +scrub.max) pause();
    }
    draw(sharpness < 1);
    clearTimeout(rest);
    if (sharpness < 1) rest = setTimeout(() => draw(false), 200);
    if (playing) ask();
  };
  const ask = () => {
    if (!asked && drawing) asked = requestAnimationFrame(frame);
  };

  // Moving -------------------------------------------------------------------------------------------------------------
  const along = (station) => {
    const stations = scene.stations;
    const s = Math.min(Math.max(station, 0), stations.length - 1);
    const i = Math.min(Math.floor(s), Math.max(stations.length - 2, 0)), part = s - i;
    const [a, b] = [stations[i], stations[Math.min(i + 1, stations.length - 1)]];
    const [x, y, z, u, v, w] = a.map((value, k) => value + part * (b[k] - value));
    view = { yaw: Math.atan2(v, u), pitch: Math.atan2(w, Math.hypot(u, v)), distance: AHEAD, target: [x, y, z] };
    const { forward } = axes();
    view.target = view.target.map((value, k) => value + AHEAD * forward[k]);
    scrub.value = s;
    const metres = Math.round(scene.before + s * scene.apart) + " m";
    count.textContent = metres;
    scrub.setAttribute("aria-valuetext", metres);
    ask();
  };
  const pause = () => {
    playing = 0;
    play.textContent = "Play";
    play.setAttribute("aria-pressed", "false");
  };
  const start = () => {
    if (+scrub.value >= +scrub.max) along(0);
    playing = 1;
    last = performance.now();
    play.textContent = "Pause";
    play.setAttribute("aria-pressed", "true");
    ask();
  };
  const orbit = (right, down) => {
    view.yaw -= right;
    view.pitch = Math.min(Math.max(view.pitch - down, -1.5), 1.5);
    ask();
  };
  const pan = (right, down) => {
    const across = axes();
    view.target = view.target.map((v, k) => v - view.distance * (right * across.right[k] - down * across.up[k]));
    ask();
  };
  const zoom = (factor) => {
    view.distance = Math.min(Math.max(view.distance * factor, 0.5), 400);
    ask();
  };

  const listen = () => {
    const fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      pause();
      canvas.focus({ preventScroll: true });
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, [event.clientX, event.clientY]);
    });
    canvas.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (!before) return;
      const now = [event.clientX, event.clientY];
      const [right, down] = [0, 1].map((k) => (now[k] - before[k]) / canvas.clientWidth);
      if (fingers.size > 1) {
        const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
        const apart = (at) => Math.hypot(at[0] - other[0], at[1] - other[1]) || 1;
        zoom(apart(before) / apart(now));
        pan(right / 2, down / 2);
      } else if (event.shiftKey || event.buttons & 6) pan(right, down);
      else orbit(3 * right, 3 * down);
      fingers.set(event.pointerId, now);
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
      canvas.addEventListener(name, (event) => fingers.delete(event.pointerId));
    }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas) return; // the page scrolls on
      event.preventDefault();
      pause();
      zoom(Math.exp(Math.min(Math.max(event.deltaY, -100), 100) / 500));
    }, { passive: false });
    const turns = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      const turn = turns[event.key];
      if (turn) (event.shiftKey ? pan : orbit)(...turn.map((v) => v * 0.06));
      else if (event.key === "+" || event.key === "=") zoom(0.9);
      else if (event.key === "-") zoom(1 / 0.9);
      else if (event.key === "Home") along(+scrub.value);
      else return;
      event.preventDefault();
      pause();
    });
    scrub.addEventListener("input", () => {
      pause();
      along(+scrub.value);
    });
    play.addEventListener("click", () => (playing ? pause() : start()));
    part(".street").addEventListener("click", () => along(+scrub.value));
    part(".above").addEventListener("click", () => {
      pause();
      along(+scrub.value);
      [view.pitch, view.distance] = [-1.1, 28];
      ask();
    });
    const tell = part(".origins"), legend = part(".legend");
    if (tell) {
      tell.addEventListener("click", () => {
        marked = !marked;
        tell.setAttribute("aria-pressed", marked);
        legend.hidden = !marked;
        ask();
      });
    }
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      drawing = null;
    });
    canvas.addEventListener("webglcontextrestored", () => {
      prepare();
      ask();
    });
    new ResizeObserver(ask).observe(canvas);
  };

  const begin = () => {
    gl = canvas.getContext("webgl2", { antialias: false, alpha: false, powerPreference: "high-performance" });
    if (!gl) return tell("This browser has no WebGL 2, which turning the scene needs.");
    try {
      read();
      prepare();
    } catch (error) {
      return tell("This browser cannot draw the scene: " + error.message);
    }
    scrub.max = scene.stations.length - 1;
    if (scene.stations.length < 2) scrub.hidden = play.hidden = count.hidden = true;
    listen();
    along(0);
  };
  // Megabytes are decoded when the view comes near, not while the page opens.
  const near = new IntersectionObserver((entries) => {
    if (!entries.some((entry) => entry.isIntersecting)) return;
    near.disconnect();
    begin();
  }, { rootMargin: "300px" });
  near.observe(box);
})();
