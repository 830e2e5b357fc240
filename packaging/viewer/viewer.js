// The turning clouds of report.html. Built into assets/viewer/viewer.min.js by packaging/build_viewer.py.
// A cloud's bytes stand in the page: zlib, base64; columns one after the other, as its JSON says.

import {
  BufferAttribute, BufferGeometry, Color, GridHelper, PerspectiveCamera, Plane, Points, PointsMaterial, Scene,
  Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

// Colour-blind safe: Okabe and Ito (2008); continuous: viridis (Smith and van der Walt 2015), 9 steps.
const KINDS = ["#999999", "#7a4a1e", "#1f8a4c", "#c2a45a", "#d55e00", "#0072b2", "#cc79a7", "#56b4e9", "#e69f00", "#f0e442"];
const VIRIDIS = ["#440154", "#472d7b", "#3b528b", "#2c728e", "#21918c", "#28ae80", "#5ec962", "#addc30", "#fde725"];
const ramp = VIRIDIS.map((hex) => new Color(hex));

async function inflate(text) {
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function unpack(about, bytes) {
  const count = about.count;
  const position = new Float32Array(3 * count);
  for (let axis = 0; axis < 3; axis++) {
    const low = bytes.subarray(2 * axis * count, (2 * axis + 1) * count);
    const high = bytes.subarray((2 * axis + 1) * count, (2 * axis + 2) * count);
    for (let k = 0; k < count; k++) position[3 * k + axis] = (low[k] + 256 * high[k]) * about.step;
  }
  const columns = {};
  about.columns.forEach((column, number) => {
    columns[column.key] = bytes.subarray((6 + number) * count, (7 + number) * count);
  });
  return { position, columns };
}

function kindColours(values) {
  const table = KINDS.map((hex) => new Color(hex));
  return (k) => table[values[k] % table.length];
}

function rampColours(share) {
  const mixed = new Color();
  return (k) => {
    const at = Math.min(Math.max(share(k), 0), 1) * (ramp.length - 1);
    const step = Math.min(Math.floor(at), ramp.length - 2);
    return mixed.copy(ramp[step]).lerp(ramp[step + 1], at - step);
  };
}

function legend(place, column, about) {
  place.replaceChildren();
  if (column.names) {
    column.names.forEach((name, number) => {
      if (!name) return;
      const one = document.createElement("span");
      const dot = document.createElement("i");
      dot.style.background = KINDS[number % KINDS.length];
      one.append(dot, name);
      place.append(one);
    });
    return;
  }
  const bar = document.createElement("span");
  bar.className = "ramp";
  bar.style.background = `linear-gradient(90deg, ${VIRIDIS.join(",")})`;
  place.append(`${column.low} `, bar, ` ${column.high} ${column.unit}`);
}

async function show(figure) {
  const about = JSON.parse(figure.querySelector("script.about").textContent);
  const bytes = await inflate(figure.querySelector("script.bytes").textContent);
  const { position, columns } = unpack(about, bytes);
  const canvas = figure.querySelector("canvas");
  const renderer = new WebGLRenderer({ canvas, antialias: true, preserveDrawingBuffer: true });
  renderer.localClippingEnabled = true;
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  const scene = new Scene();
  scene.background = new Color("#f4f7f4");
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(position, 3));
  const colour = new Uint8Array(3 * about.count);
  geometry.setAttribute("color", new BufferAttribute(colour, 3, true));
  const size = new Vector3(...about.size);
  const top = new Plane(new Vector3(0, 0, -1), size.z);
  const front = new Plane(new Vector3(0, -1, 0), size.y);
  const material = new PointsMaterial({
    size: about.dot, vertexColors: true, sizeAttenuation: true, clippingPlanes: [top, front],
  });
  scene.add(new Points(geometry, material));
  const side = Math.ceil(Math.max(size.x, size.y) / about.grid) * about.grid;
  const grid = new GridHelper(side, Math.round(side / about.grid), "#9aa79e", "#ccd5ce");
  grid.rotation.x = Math.PI / 2;
  grid.position.set(size.x / 2, size.y / 2, about.floor);
  scene.add(grid);
  const far = size.length();
  const camera = new PerspectiveCamera(40, 2, far / 2000, far * 20);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, canvas);
  controls.target.set(size.x / 2, size.y / 2, size.z * 0.4);
  camera.position.set(size.x / 2 + far * 0.4, size.y / 2 - far * 0.8, size.z * 0.4 + far * 0.35);
  controls.update();
  const draw = () => renderer.render(scene, camera);
  const fit = () => {
    const { clientWidth: wide, clientHeight: high } = canvas;
    renderer.setSize(wide, high, false);
    camera.aspect = wide / high;
    camera.updateProjectionMatrix();
    draw();
  };
  const paint = (key) => {
    const column = about.columns.find((one) => one.key === key) ?? about.height;
    const values = columns[key];
    const at = !values
      ? rampColours((k) => position[3 * k + 2] / size.z)
      : column.names ? kindColours(values) : rampColours((k) => values[k] / 255);
    for (let k = 0; k < about.count; k++) {
      const c = at(k);
      colour[3 * k] = 255 * c.r; // linear, as the renderer takes them
      colour[3 * k + 1] = 255 * c.g;
      colour[3 * k + 2] = 255 * c.b;
    }
    geometry.attributes.color.needsUpdate = true;
    legend(figure.querySelector(".legend"), column, about);
    draw();
  };
  controls.addEventListener("change", draw);
  const by = figure.querySelector("select");
  by.addEventListener("change", () => paint(by.value));
  const [height, depth] = figure.querySelectorAll("input");
  height.addEventListener("input", () => { top.constant = (size.z * 1.001 * height.value) / 100; draw(); });
  depth.addEventListener("input", () => {
    front.set(new Vector3(0, 1, 0), -(size.y * (100 - depth.value)) / 100 + 1e-3); draw();
  });
  front.set(new Vector3(0, 1, 0), 1e-3);
  top.constant = size.z * 1.001;
  new ResizeObserver(fit).observe(canvas);
  paint(by.value);
  fit();
  figure.dataset.ready = "yes";
}

for (const figure of document.querySelectorAll("figure.cloud")) {
  show(figure).catch((problem) => {
    figure.querySelector(".legend").textContent = `This browser cannot show the cloud: ${problem.message}`;
  });
}
