"use strict";
(() => {
  const $ = (id) => document.getElementById(id);
  const data = JSON.parse($("data").textContent);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

  // The model: its arrays are read here, too, for the layout and for what is named in 3D.
  const file = bytes(data.model);
  const head = new DataView(file.buffer);
  const length = head.getUint32(12, true);
  const gltf = JSON.parse(new TextDecoder().decode(file.subarray(20, 20 + length)));
  const array = (index) => {
    const accessor = gltf.accessors[index];
    const start = 28 + length + gltf.bufferViews[accessor.bufferView].byteOffset;
    const size = { SCALAR: 1, VEC2: 2, VEC3: 3 }[accessor.type] * accessor.count;
    const kind = accessor.componentType === 5126 ? Float32Array : Uint32Array;
    return new kind(file.buffer.slice(start, start + 4 * size));
  };
  const primitives = gltf.meshes[0].primitives.map((primitive) => ({
    corners: array(primitive.indices),
    material: Number(gltf.materials[primitive.material].name),
  }));
  const { TEXCOORD_0: uvIndex, POSITION: positions } = gltf.meshes[0].primitives[0].attributes;
  const uv = uvIndex === undefined ? null : array(uvIndex);
  const chart = new Uint32Array(bytes(data.chart).buffer);
  const count = gltf.accessors[positions].count;

  // From sRGB, as colours are shown, to linear light, as they are drawn in 3D.
  const linear = Float32Array.from({ length: 256 }, (_, k) => {
    const x = k / 255;
    return x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4;
  });
  const shown = (x) => 255 * (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055);

  // Colours of the vertices, as shown, 0 to 255; a picture is multiplied by them.
  const colours = (look) => {
    const found = new Float32Array(3 * count).fill(255);
    const pick = (table, index) => {
      for (let k = 0; k < count; k++) found.set(table.subarray(3 * index[k], 3 * index[k] + 3), 3 * k);
    };
    if (look.kind === "charts") pick(bytes(look.colours), chart);
    else if (look.kind === "scale") pick(bytes(look.map), bytes(look.values));
    else if (look.kind === "colours") found.set(bytes(look.colours));
    else if (look.kind === "plain") found.fill(200);
    else if (look.kind === "picture") {
      const tint = look.tint ? bytes(look.tint) : null;
      for (const { corners, material } of primitives) {
        const colour = data.pictures[Math.min(material, data.pictures.length - 1)].colour;
        for (const v of corners) {
          for (let c = 0; c < 3; c++) found[3 * v + c] = shown(colour[c] * (tint ? tint[3 * v + c] / 255 : 1));
        }
      }
    }
    return found;
  };

  const loaded = (source) => new Promise((done) => {
    if (!source) return done(null);
    const image = new Image();
    image.onload = () => done(image);
    image.onerror = () => done(null);
    image.src = source;
  });
  const board = () => {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 128;
    const paint = canvas.getContext("2d");
    paint.fillStyle = "#f6f2e9";
    paint.fillRect(0, 0, 128, 128);
    paint.fillStyle = "#343e56";
    paint.fillRect(0, 0, 64, 64);
    paint.fillRect(64, 64, 64, 64);
    return canvas;
  };

  const viewer = $("viewer");
  const state = { look: null, colours: null, named: -1, images: [], scene: null, textures: new Map() };

  // In 3D.
  const meshes = () => {
    const found = [];
    state.scene?.traverse((object) => {
      if (object.isMesh && object.geometry?.attributes.position?.count === count) found.push(object);
    });
    return found;
  };
  const texture = (image, repeat) => {
    const key = `${state.images.indexOf(image)} ${repeat}`;
    if (!state.textures.has(key)) {
      const made = new ModelViewerElement.CanvasTexture(image);
      made.flipY = false;
      made.colorSpace = "srgb";
      made.wrapS = made.wrapT = 1000;
      made.anisotropy = 8;
      if (repeat) made.repeat.set(repeat, repeat);
      state.textures.set(key, made);
    }
    return state.textures.get(key);
  };
  const dress = () => {
    if (!state.scene) return;
    const { look } = state;
    const light = new Float32Array(3 * count);
    const dim = (v) => state.named >= 0 && chart[v] !== state.named;
    for (let v = 0; v < count; v++) {
      const part = dim(v) ? 0.35 : 1;
      for (let c = 0; c < 3; c++) light[3 * v + c] = part * linear[Math.round(state.colours[3 * v + c])];
    }
    let attribute = null;
    for (const mesh of meshes()) {
      const { attributes } = mesh.geometry;
      attribute ??= new attributes.position.constructor(light, 3);
      mesh.geometry.setAttribute("color", attribute);
      const number = Number(mesh.material.name);
      let map = null;
      if (look.kind === "picture" && uv) {
        const image = state.images[Math.min(number, state.images.length - 1)];
        if (image) map = texture(image, 0);
      } else if (look.kind === "checker") map = texture(state.board, look.squares / 2);
      mesh.material.map = map;
      mesh.material.vertexColors = true;
      mesh.material.needsUpdate = true;
    }
    state.scene.queueRender();
  };

  // The layout.
  const paper = $("paper");
  const place = (v) => {
    const { low, side } = data.layout;
    const scale = paper.width / side;
    // v is down in the file.
    return [(uv[2 * v] - low[0]) * scale, paper.height - (1 - uv[2 * v + 1] - low[1]) * scale];
  };
  const triangles = (corners, each) => {
    for (let k = 0; k < corners.length; k += 3) {
      const [a, b, c] = [corners[k], corners[k + 1], corners[k + 2]];
      const [p, q, r] = [place(a), place(b), place(c)];
      // In one sense: of two turned to each other nothing would be filled.
      const turned = (q[0] - p[0]) * (r[1] - p[1]) < (q[1] - p[1]) * (r[0] - p[0]);
      const path = new Path2D();
      path.moveTo(...p);
      path.lineTo(...(turned ? r : q));
      path.lineTo(...(turned ? q : r));
      path.closePath();
      each(path, a, b, c);
    }
  };
  const lay = () => {
    if (!data.layout) return;
    const size = Math.round($("sheet").clientWidth * Math.min(window.devicePixelRatio || 1, 2));
    if (!size) return;
    paper.width = paper.height = size;
    const paint = paper.getContext("2d");
    const { look } = state;
    const { low, side } = data.layout;
    const scale = size / side;
    // A picture over one unit of the plane, tiled.
    const tiled = (image, part) => {
      const pattern = paint.createPattern(image, "repeat");
      const unit = scale * part;
      const down = size - (1 - low[1]) * scale;
      pattern.setTransform(new DOMMatrix([unit / image.width, 0, 0, unit / image.height, -low[0] * scale, down]));
      return pattern;
    };
    if (look.kind === "picture" || look.kind === "checker") {
      for (const { corners, material } of primitives) {
        const image = look.kind === "checker" ? state.board : state.images[Math.min(material, state.images.length - 1)];
        if (!image) continue;
        const fill = tiled(image, look.kind === "checker" ? 2 / look.squares : 1);
        if (primitives.length === 1) {
          paint.globalAlpha = 0.25;
          paint.fillStyle = fill;
          paint.fillRect(0, 0, size, size);
          paint.globalAlpha = 1;
        }
        const whole = new Path2D();
        triangles(corners, (path) => whole.addPath(path));
        paint.fillStyle = fill;
        paint.fill(whole);
      }
      if (look.kind === "checker") return;
    }
    for (const { corners, material } of primitives) {
      if (look.kind === "picture" && state.images[Math.min(material, state.images.length - 1)]) continue;
      triangles(corners, (path, a, b, c) => {
        const mean = [0, 1, 2].map((k) => Math.round((state.colours[3 * a + k] + state.colours[3 * b + k] + state.colours[3 * c + k]) / 3));
        paint.fillStyle = paint.strokeStyle = `rgb(${mean})`;
        paint.fill(path);
        // Neighbours would let the paper through between them.
        paint.stroke(path);
      });
    }
  };

  // What is named, in both.
  const number = (x) => Number(x.toPrecision(3)).toString();
  const say = () => {
    const { look, named } = state;
    const readout = $("readout");
    readout.textContent = "";
    if (named < 0 || !data.charts[named]) {
      readout.append(look.caption || "");
      return;
    }
    const title = document.createElement("b");
    const noun = data.noun[0].toUpperCase() + data.noun.slice(1);
    title.textContent = `${noun} ${named}`;
    const { share, stretch } = data.charts[named];
    const stretched = stretch === undefined ? "" : ` · mean stretch × ${number(stretch)}`;
    readout.append(title, ` · ${number(share)} % of the area${stretched}`);
  };
  const name = (index) => {
    if (index === state.named || !data.charts.length) return;
    state.named = index;
    const svg = $("outlines");
    svg.querySelector(".named")?.classList.remove("named");
    svg.classList.toggle("naming", index >= 0);
    svg.children[index]?.classList.add("named");
    say();
    dress();
  };

  // The legend of a scale.
  const ticks = (low, high) => {
    const steps = [1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2, 2.5, 3, 4, 5, 6, 8];
    const found = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.log10(high); power++) {
      for (const step of steps) {
        const value = Number((step * 10 ** power).toPrecision(6));
        if (value > low && value < high) found.push(value);
      }
    }
    const place = (value) => Math.log(value / low) / Math.log(high / low);
    const kept = [low];
    for (const value of found) {
      if (place(value) - place(kept[kept.length - 1]) > 0.19 && place(value) < 0.8) kept.push(value);
    }
    return [...kept, high].map((value) => [value, place(value)]);
  };
  const legend = () => {
    const { look } = state;
    $("legend").hidden = look.kind !== "scale";
    if (look.kind !== "scale") return;
    const ramp = $("ramp").getContext("2d");
    const map = bytes(look.map);
    for (let k = 0; k < 256; k++) {
      ramp.fillStyle = `rgb(${map.subarray(3 * k, 3 * k + 3).join()})`;
      ramp.fillRect(k, 0, 1, 1);
    }
    $("unit").textContent = look.unit === "times" ? "" : look.unit;
    $("ticks").textContent = "";
    for (const [value, place] of ticks(look.low, look.high)) {
      const tick = document.createElement("span");
      tick.style.left = `${100 * place}%`;
      tick.textContent = (look.unit === "times" ? "× " : "") + number(value);
      $("ticks").append(tick);
    }
  };

  const show = (look) => {
    state.look = look;
    state.colours = colours(look);
    for (const button of $("looks").children) {
      button.setAttribute("aria-pressed", button.value === look.id);
    }
    say();
    legend();
    lay();
    dress();
    document.documentElement.dataset.look = look.id;
  };
  const linked = () => data.looks.find((look) => `#${look.id}` === location.hash) ?? data.looks[0];

  for (const look of data.looks) {
    const button = document.createElement("button");
    button.type = "button";
    button.value = look.id;
    button.textContent = look.label;
    button.onclick = () => {
      // A page within a page has no address of its own.
      try { history.replaceState(null, "", `#${look.id}`); } catch { /* about:srcdoc */ }
      show(look);
    };
    $("looks").append(button);
  }
  $("looks").hidden = data.looks.length < 2;
  window.addEventListener("hashchange", () => show(linked()));

  if (data.layout) {
    $("layout").hidden = false;
    document.querySelector(".panes").classList.add("two");
    const svg = $("outlines");
    svg.setAttribute("viewBox", `0 0 ${data.layout.units} ${data.layout.units}`);
    data.layout.outlines.forEach((outlined, index) => {
      const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
      path.setAttribute("d", outlined);
      path.dataset.chart = index;
      if (data.charts.length <= 100) {
        path.setAttribute("tabindex", "0");
        path.setAttribute("role", "img");
        path.setAttribute("aria-label", `${data.noun} ${index}`);
      }
      svg.append(path);
    });
    const over = (event) => name(Number(event.target.dataset?.chart ?? -1));
    svg.addEventListener("pointerover", over);
    svg.addEventListener("pointerleave", () => name(-1));
    svg.addEventListener("focusin", over);
    svg.addEventListener("focusout", () => name(-1));
    new ResizeObserver(() => state.look && lay()).observe($("sheet"));
  }

  let pending = null;
  viewer.addEventListener("pointermove", (event) => {
    if (event.buttons || !data.charts.length) return;
    if (pending === null) {
      requestAnimationFrame(() => {
        const { clientX, clientY } = pending;
        pending = null;
        // Mesh, primitive, three vertices, their weights.
        const hit = viewer.surfaceFromPoint?.(clientX, clientY);
        name(hit ? chart[Number(hit.split(" ")[2])] : -1);
      });
    }
    pending = event;
  });
  viewer.addEventListener("pointerleave", () => name(-1));
  viewer.addEventListener("error", () => { $("failed").hidden = false; });
  viewer.addEventListener("load", () => {
    // Colours of vertices are no part of the element's interface, but of the scene it draws.
    const key = Object.getOwnPropertySymbols(viewer).find((symbol) => symbol.description === "scene");
    state.scene = viewer[key];
    dress();
    requestAnimationFrame(() => requestAnimationFrame(() => {
      document.documentElement.dataset.ready = "";
    }));
  });

  state.board = board();
  Promise.all(data.pictures.map((picture) => loaded(picture.data))).then((images) => {
    state.images = images;
    show(linked());
    viewer.cameraOrbit = `${data.orbit[0]}deg ${data.orbit[1]}deg auto`;
    viewer.src = URL.createObjectURL(new Blob([file], { type: "model/gltf-binary" }));
  });
})();
