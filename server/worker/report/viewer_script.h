#pragma once

namespace saltus::report {

/// What makes the viewer move. Plain and without libraries: it paints slices of the volumes that the page carries.
inline constexpr char viewer_script[] = R"js(
"use strict";
(async () => {
  const root = document.getElementById("viewer");
  const g = JSON.parse(root.dataset.geometry);
  const [nx, ny, nz] = g.size;
  const volumes = {};
  for (const image of root.querySelectorAll("img[data-volume]")) {
    await image.decode();
    const canvas = document.createElement("canvas");
    canvas.width = image.naturalWidth; canvas.height = image.naturalHeight;
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0);
    const pixels = context.getImageData(0, 0, canvas.width, canvas.height).data;
    const volume = new Uint8Array(nx * ny * nz);
    for (let z = 0, i = 0; z < nz; ++z) {
      const left = (z % g.columns) * nx, top = Math.floor(z / g.columns) * ny;
      for (let y = 0; y < ny; ++y)
        for (let x = 0; x < nx; ++x, ++i) volume[i] = pixels[4 * ((top + y) * canvas.width + left + x)];
    }
    volumes[image.dataset.volume] = volume;
    image.remove();
  }
  const table = (text) => Uint8Array.from({ length: text.length / 2 }, (_, i) => parseInt(text.substr(2 * i, 2), 16));
  const sequential = table(g.sequential), diverging = table(g.diverging), folded = table(g.folded);
  const strides = [1, nx, nx * ny];
  const { fixed, moving, registered, displacement, jacobian } = volumes;
  const split = root.querySelector("[data-split]");
  let view = "wipe", phase = 0, at = g.start.slice();

  const grey = (v) => [v, v, v];
  const mapped = (colours, t) => {
    const i = 3 * Math.max(0, Math.min(255, Math.round(255 * t)));
    return [colours[i], colours[i + 1], colours[i + 2]];
  };
  const difference = (volume) => (v) => mapped(diverging, 0.5 + (volume[v] - fixed[v]) / 255 / g.differenceRange / 2);
  const colourOf = {
    fixed: (v) => grey(fixed[v]),
    moving: (v) => grey(moving[v]),
    registered: (v) => grey(registered[v]),
    wipe: (v, s) => grey(s < split.value / 100 ? fixed[v] : registered[v]),
    flicker: (v) => grey(phase ? registered[v] : fixed[v]),
    checkerboard: (v, s, t) => grey((Math.floor(8 * s) + Math.floor(8 * t)) % 2 ? registered[v] : fixed[v]),
    before: difference(moving),
    after: difference(registered),
    displacement: (v) => mapped(sequential, displacement[v] / 255),
    jacobian: (v) => jacobian[v] === 0 ? folded : mapped(diverging, 0.5 + (jacobian[v] - 128) / 254),
  };

  const paint = (panel) => {
    const p = g.planes[panel.dataset.plane], canvas = panel.querySelector("canvas");
    const w = g.size[p.right], h = g.size[p.down], context = canvas.getContext("2d");
    canvas.width = w; canvas.height = h;
    const picture = context.createImageData(w, h), colour = colourOf[view];
    const base = p.across < 0 ? 0 : at[p.across] * strides[p.across];
    for (let y = 0, i = 0; y < h; ++y) {
      const row = base + (p.downReversed ? h - 1 - y : y) * strides[p.down];
      for (let x = 0; x < w; ++x, i += 4) {
        const [r, gr, b] = colour(row + (p.rightReversed ? w - 1 - x : x) * strides[p.right], (x + 0.5) / w, (y + 0.5) / h);
        picture.data[i] = r; picture.data[i + 1] = gr; picture.data[i + 2] = b; picture.data[i + 3] = 255;
      }
    }
    context.putImageData(picture, 0, 0);
    const place = (axis, isReversed) => 100 * ((isReversed ? g.size[axis] - 1 - at[axis] : at[axis]) + 0.5) / g.size[axis];
    panel.querySelector(".upright").style.left = place(p.right, p.rightReversed) + "%";
    panel.querySelector(".level").style.top = place(p.down, p.downReversed) + "%";
    panel.querySelector(".sweep").style.left = split.value + "%";
    const slider = panel.querySelector("[data-slice]");
    if (slider) slider.value = at[p.across];
  };
  const panels = [...root.querySelectorAll("[data-plane]")];
  const readout = root.querySelector(".readout");
  const show = () => {
    panels.forEach(paint);
    const v = at[0] + nx * (at[1] + ny * at[2]);
    const world = g.origin.map((o, i) => (o + g.axes[i].reduce((sum, a, j) => sum + a * at[j], 0)).toFixed(1));
    const j = jacobian[v] === 0 ? "not positive" : Math.pow(g.jacobianRange, (jacobian[v] - 128) / 127).toFixed(2);
    readout.textContent = `At ${world.join(", ")} mm (LPS): displacement ` +
      `${(displacement[v] / 255 * g.displacementRange).toFixed(1)} mm, Jacobian ${j}`;
    root.dataset.shown = view;
    for (const button of root.querySelectorAll("[data-view]"))
      button.setAttribute("aria-pressed", String(button.dataset.view === view));
    for (const legend of root.querySelectorAll("[data-for]")) legend.hidden = !legend.dataset.for.split(" ").includes(view);
    root.classList.toggle("wiping", view === "wipe");
  };

  for (const button of root.querySelectorAll("[data-view]"))
    button.addEventListener("click", () => { view = button.dataset.view; show(); });
  split.addEventListener("input", show);
  for (const panel of panels) {
    const p = g.planes[panel.dataset.plane], canvas = panel.querySelector("canvas");
    const slider = panel.querySelector("[data-slice]");
    if (slider) slider.addEventListener("input", () => { at[p.across] = Number(slider.value); show(); });
    canvas.addEventListener("click", (event) => {
      const box = canvas.getBoundingClientRect();
      const pick = (share, axis, isReversed) => {
        const i = Math.max(0, Math.min(g.size[axis] - 1, Math.floor(share * g.size[axis])));
        at[axis] = isReversed ? g.size[axis] - 1 - i : i;
      };
      pick((event.clientX - box.left) / box.width, p.right, p.rightReversed);
      pick((event.clientY - box.top) / box.height, p.down, p.downReversed);
      show();
    });
  }
  setInterval(() => { phase = 1 - phase; if (view === "flicker") panels.forEach(paint); }, 600);
  const asked = () => {
    const name = new URLSearchParams(location.hash.slice(1)).get("view");
    if (name in colourOf) view = name;
    show();
  };
  addEventListener("hashchange", asked);
  root.hidden = false;
  asked();
  root.dataset.state = "ready";
})();
)js";

}  // namespace saltus::report
