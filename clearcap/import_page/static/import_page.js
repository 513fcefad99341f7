"use strict";
// The parts in 3D: what is selected in the list, by its name or on a part, is highlighted, and the rest is transparent.
(function () {
  const HIGHLIGHT = "#e0a000", SEEN_THROUGH = 0.14, LEAST_DRAG = 5; // px; a shorter drag counts as a click
  const canvas = document.querySelector("#scene canvas");
  // The context is requested here and not by three.js, which logs errors in the console if there is none.
  const context = canvas.getContext("webgl2", { antialias: true });
  if (!context) return;
  const data = JSON.parse(document.getElementById("data").textContent);
  const element = (id) => document.getElementById(id);
  for (const id of ["scene", "tools", "hint", "stand"]) element(id).hidden = false;
  for (const id of ["flat", "drawing"]) element(id).hidden = true;

  const renderer = new THREE.WebGLRenderer({ canvas, context });
  renderer.setClearColor("#f4f6f9");
  const scene = new THREE.Scene();
  const half = Math.max(data.size / 2, 1e-6);
  const camera = new THREE.OrthographicCamera();
  const light = new THREE.DirectionalLight("#ffffff", 2.2);
  camera.add(light);
  light.position.set(0.4, 0.7, 1);
  scene.add(camera, new THREE.AmbientLight("#ffffff", 1.1));

  function decoded(text, kind) {
    return new kind(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  }

  function partOf(part) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(decoded(part.vertices, Float32Array), 3));
    geometry.setIndex(new THREE.BufferAttribute(decoded(part.triangles, Uint32Array), 1));
    geometry.computeVertexNormals();
    const mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ color: part.colour, side: 2 }));
    mesh.userData.row = part.row;
    scene.add(mesh);
    return { ...part, mesh };
  }

  function linesOf(place) {
    const ends = place.lines.flatMap((line) => line.slice(1).flatMap((end, i) => [...line[i], ...end]));
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(ends), 3));
    const lines = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: place.colour, depthTest: false }));
    lines.renderOrder = 2;
    lines.visible = place.shown;
    scene.add(lines);
    return lines;
  }

  function tagOf(place) {
    const tag = document.createElement("span");
    tag.textContent = place.name;
    tag.dataset.row = place.row;
    tag.style.color = place.colour;
    tag.addEventListener("click", () => select(place.row));
    element("tags").append(tag);
    return tag;
  }

  const parts = data.parts.map(partOf);
  const places = data.places.map((place) => ({ ...place, drawn: linesOf(place), tag: tagOf(place) }));
  const buttons = [...document.querySelectorAll("button[data-row]")];
  let chosen = "", marks = [];

  // Return the faces of a place, drawn over their parts. They are never disposed of, because three.js would dispose of
  // the vertices of the part with them.
  function marksOf(place) {
    const found = [];
    for (const part of parts) {
      const rows = part.numbers.flatMap((number, i) => (place.faces.includes(number) ? [part.faces[i]] : []));
      for (const [first, count] of rows) {
        const geometry = new THREE.BufferGeometry();
        for (const name of ["position", "normal"]) geometry.setAttribute(name, part.mesh.geometry.getAttribute(name));
        const triangles = part.mesh.geometry.getIndex().array.subarray(3 * first, 3 * (first + count));
        geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
        const look = { color: HIGHLIGHT, side: 2, polygonOffset: true, polygonOffsetFactor: -2, polygonOffsetUnits: -2 };
        const mesh = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial(look));
        mesh.renderOrder = 1;
        scene.add(mesh);
        found.push(mesh);
      }
    }
    return found;
  }

  function select(row) {
    chosen = row === chosen ? "" : row;
    const place = places.find((each) => each.row === chosen);
    for (const mesh of marks) mesh.visible = false;
    marks = place ? (place.marks ??= marksOf(place)) : [];
    for (const mesh of marks) mesh.visible = true;
    for (const part of parts) {
      const through = chosen !== "" && part.row !== chosen;
      Object.assign(part.mesh.material, { transparent: through, opacity: through ? SEEN_THROUGH : 1, depthWrite: !through });
      part.mesh.material.needsUpdate = true;
    }
    for (const each of places) each.drawn.visible = each.row === chosen || (each.shown && !place);
    for (const button of buttons) button.setAttribute("aria-pressed", String(button.dataset.row === chosen));
    const part = parts.find((each) => each.row === chosen);
    element("selected").textContent = place || part ? "Selected: " + (place || part).name : "";
    if (part) document.dispatchEvent(new CustomEvent("part", { detail: part.name }));
    render();
  }

  // Return the part that was hit, and the normal of the face, if that is flat.
  function faceOf(hit) {
    const part = parts.find((each) => each.mesh === hit.object);
    const plane = part.planes.find(([first, count]) => first <= hit.faceIndex && hit.faceIndex < first + count);
    return { part: part.name, normal: plane?.slice(2) };
  }

  function showTags() {
    const { clientWidth: width, clientHeight: height } = canvas;
    for (const { tag, at, row, shown } of places) {
      tag.hidden = row !== chosen && !(element("names").checked && shown);
      tag.classList.toggle("chosen", row === chosen);
      const seen = new THREE.Vector3(...at).project(camera);
      tag.style.transform = `translate(${(seen.x + 1) / 2 * width + 6}px, ${(1 - seen.y) / 2 * height - 22}px)`;
    }
  }

  function render() {
    renderer.render(scene, camera);
    showTags();
  }

  function fit() {
    const { clientWidth: width, clientHeight: height } = canvas;
    const [across, up] = [half * Math.max(1, width / height), half * Math.max(1, height / width)];
    Object.assign(camera, { left: -across, right: across, top: up, bottom: -up, near: 0, far: 40 * half });
    camera.updateProjectionMatrix();
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    render();
  }

  const [right, up, normal] = data.view.map((each) => new THREE.Vector3(...each));
  camera.up.copy(up);
  camera.position.copy(normal).addScaledVector(right, 0.35).addScaledVector(up, 0.45).setLength(20 * half);
  const controls = new THREE.OrbitControls(camera, canvas);
  controls.listenToKeyEvents(canvas);
  controls.update();
  controls.saveState();
  controls.addEventListener("change", render);

  let pressed = null;
  canvas.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    const moved = pressed ? Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) : Infinity;
    pressed = null;
    if (moved >= LEAST_DRAG || event.button !== 0) return;
    const box = canvas.getBoundingClientRect();
    const at = new THREE.Vector2(
      (event.clientX - box.left) / box.width * 2 - 1, 1 - (event.clientY - box.top) / box.height * 2);
    const ray = new THREE.Raycaster();
    ray.setFromCamera(at, camera);
    const [hit] = ray.intersectObjects(parts.map((part) => part.mesh), false);
    if (element("stand").getAttribute("aria-pressed") === "true") {
      if (hit) document.dispatchEvent(new CustomEvent("face", { detail: faceOf(hit) }));
      return;
    }
    const row = hit ? hit.object.userData.row : "";
    if (row || chosen) select(row || chosen);
  });
  canvas.addEventListener("keydown", (event) => {
    const factor = { "+": 1.2, "=": 1.2, "-": 1 / 1.2 }[event.key];
    if (!factor) return;
    camera.zoom *= factor;
    camera.updateProjectionMatrix();
    controls.update();
    render();
  });
  document.addEventListener("keydown", (event) => { if (event.key === "Escape" && chosen) select(chosen); });
  for (const button of buttons) {
    button.disabled = false;
    button.addEventListener("click", () => select(button.dataset.row));
  }
  element("names").addEventListener("change", render);
  element("reset").addEventListener("click", () => { controls.reset(); render(); });
  canvas.addEventListener("webglcontextlost", () => {
    for (const id of ["scene", "tools", "hint", "stand"]) element(id).hidden = true;
    for (const id of ["flat", "drawing"]) element(id).hidden = false;
  });
  new ResizeObserver(fit).observe(canvas);
  fit();
})();
