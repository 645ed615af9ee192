// The photograph that a row of the table chooses: beside its model, its residual, and both along a line.
"use strict";

(() => {
  const root = document.getElementById("viewer");
  const images = matest.data("photographs-data");
  if (root === null || images === null) return;

  // See previews.py.
  const [CODES, ZERO, STEPS] = [3, 128, 511];
  // Of the line past the object at first, in shares of the picture.
  const BEYOND = 0.03;
  const part = (name) => root.querySelector(name);
  const [photo, render] = [part(".photo"), part(".render")];
  const canvas = part("canvas.residual");
  const split = part("input.split");
  const range = part("input.range");
  const line = { from: [0.08, 0.5], to: [0.92, 0.5] };
  const handles = { from: part(".handle.from"), to: part(".handle.to") };
  const current = {};

  const colours = () => {
    const style = getComputedStyle(root);
    const read = (name) => style.getPropertyValue(name).trim().match(/[0-9a-f]{2}/gi).map((part) => parseInt(part, 16));
    return { low: read("--darker"), zero: read("--agree"), high: read("--brighter"), none: read("--idle") };
  };

  const rounded = (value) => Number(value.toPrecision(2));

  // Standard deviations of full colour: the slider is logarithmic.
  const full = () => rounded(10 ** Number(range.value));

  const drawResidual = () => {
    const { residual, image } = current;
    [canvas.width, canvas.height] = [image.width, image.height];
    const context = canvas.getContext("2d");
    const pixels = context.createImageData(image.width, image.height);
    const { low, zero, high, none } = colours();
    const table = Array.from({ length: 256 }, (_, code) => {
      if (code === 0) return none;
      const strength = matest.clamp((2 * Math.sinh((code - ZERO) / CODES)) / full(), -1, 1);
      return zero.map((part, k) => part + Math.abs(strength) * ((strength > 0 ? high : low)[k] - part));
    });
    residual.forEach((code, place) => pixels.data.set([...table[code], 255], 4 * place));
    context.putImageData(pixels, 0, 0);
    part("output.range").textContent = `full colour at ${full()} σ`;
  };

  // Brightness of photograph (0) or model (1) at a place in shares of the picture.
  const brightness = (kind, [x, y]) => {
    const { image, levels } = current;
    const rows = levels.length / 2 / image.columns;
    const column = matest.clamp(Math.floor(x * image.columns), 0, image.columns - 1);
    const row = matest.clamp(Math.floor(y * rows), 0, rows - 1);
    return image.top * (levels[(kind * rows + row) * image.columns + column] / STEPS) ** 2;
  };

  // Lay the line across the object, a little beyond its ends, where the model is brightest.
  const cross = () => {
    const { image, levels } = current;
    const rows = levels.length / 2 / image.columns;
    const model = (row) => levels.subarray((rows + row) * image.columns, (rows + row + 1) * image.columns);
    const light = Array.from({ length: rows }, (_, row) => model(row).reduce((sum, level) => sum + level ** 2, 0));
    const brightest = light.indexOf(Math.max(...light));
    const lit = [...model(brightest).keys()].filter((column) => model(brightest)[column] > 0);
    if (lit.length === 0) return;
    const height = (brightest + 0.5) / rows;
    line.from = [Math.max(lit[0] / image.columns - BEYOND, 0), height];
    line.to = [Math.min((lit.at(-1) + 1) / image.columns + BEYOND, 1), height];
  };

  // As many values as the line crosses pixels.
  const along = (kind) => {
    const rows = current.levels.length / 2 / current.image.columns;
    const crossed = [current.image.columns, rows].map((side, axis) => side * Math.abs(line.to[axis] - line.from[axis]));
    const last = Math.max(Math.round(Math.max(...crossed)), 1);
    return Array.from({ length: last + 1 }, (_, place) =>
      brightness(kind, [0, 1].map((axis) => line.from[axis] + (place / last) * (line.to[axis] - line.from[axis]))),
    );
  };

  const drawProfile = () => {
    const { image } = current;
    const [photograph, model] = [along(0), along(1)];
    const sides = [image.width, image.height].map((side, axis) => side * image.step * (line.to[axis] - line.from[axis]));
    const curves = [
      { name: "measured", values: photograph },
      { name: "modelled", values: model },
    ];
    matest.chart(part("svg.profile"), curves, Math.hypot(...sides), "pixels along the line", "brightness");
    const rms = (values) => Math.sqrt(values.reduce((sum, value) => sum + value * value, 0) / values.length);
    const apart = rms(photograph.map((value, place) => value - model[place])) / (rms(photograph) || 1);
    part(".reading").textContent = `Along the line the rms difference is ${rounded(100 * apart)} % of the brightness.`;
    for (const end of ["from", "to"]) {
      handles[end].style.left = `${100 * line[end][0]}%`;
      handles[end].style.top = `${100 * line[end][1]}%`;
    }
    for (const drawn of root.querySelectorAll("line")) {
      ["x1", "y1", "x2", "y2"].forEach((name, k) => drawn.setAttribute(name, 100 * [...line.from, ...line.to][k]));
    }
  };

  const drawSplit = () => part(".compare").style.setProperty("--split", `${split.value}%`);

  const show = async (place) => {
    const image = images[place];
    const [residual, levels] = await Promise.all([
      matest.unpacked(image.residual, 1, 1),
      matest.unpacked(image.brightness, image.columns, 2),
    ]);
    const first = current.image === undefined;
    Object.assign(current, { image, residual, levels });
    if (first) cross();
    [photo.src, render.src] = [image.photo, image.render];
    root.style.setProperty("--aspect", `${image.width} / ${image.height}`);
    part(".name").textContent = image.name;
    part(".step").textContent = image.step > 1 ? `one pixel of every ${image.step}×${image.step}` : "every pixel";
    part(".full").hidden = !image.full;
    for (const link of part(".full").querySelectorAll("a")) {
      link.href = `images/${String(image.number).padStart(2, "0")}_${link.dataset.kind}.png`;
    }
    for (const row of document.querySelectorAll("tr[data-image]")) {
      row.toggleAttribute("data-shown", Number(row.dataset.image) === image.number);
      row.querySelector("button").setAttribute("aria-pressed", Number(row.dataset.image) === image.number);
    }
    drawResidual();
    drawProfile();
    root.dataset.shown = String(image.number);
  };

  // The nearer end of the line follows the pointer; far from both, on the picture of both, the split does.
  const pull = (compare) => {
    let held = null;
    return (x, y, down) => {
      const place = [matest.clamp(x, 0, 1), matest.clamp(y, 0, 1)];
      if (down) {
        const far = (end) => Math.hypot(line[end][0] - x, line[end][1] - y);
        held = far("from") < far("to") ? "from" : "to";
        if (far(held) > 0.12 && compare) held = "split";
      }
      if (held === "split") {
        split.value = 100 * place[0];
        drawSplit();
      } else {
        line[held] = place;
        drawProfile();
      }
    };
  };

  for (const row of document.querySelectorAll("tr[data-image]")) {
    const place = images.findIndex((image) => image.number === Number(row.dataset.image));
    row.querySelector("button").addEventListener("click", () => show(place));
  }
  for (const [end, handle] of Object.entries(handles)) {
    handle.addEventListener("keydown", (event) => {
      const arrow = matest.arrow(event);
      if (arrow === null) return;
      line[end] = line[end].map((share, axis) => matest.clamp(share + arrow[axis] / 100, 0, 1));
      drawProfile();
    });
  }
  matest.drag(part(".compare .pad"), pull(true));
  matest.drag(part(".residuals .pad"), pull(false));
  new ResizeObserver(() => current.image && drawProfile()).observe(part(".chart"));
  split.addEventListener("input", drawSplit);
  range.addEventListener("input", drawResidual);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", drawResidual);
  range.value = Math.log10(Number(root.dataset.range));
  drawSplit();
  show(0);
})();
