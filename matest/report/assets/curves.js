// A chart of curves over a common axis, as SVG: it follows the colours of the page.
"use strict";

(() => {
  const [HEIGHT, LEFT, TOP, BOTTOM] = [230, 58, 8, 192];

  // Round numbers from 0 or below to the largest value.
  const ticks = (low, high) => {
    const power = 10 ** Math.floor(Math.log10((high - low || 1) / 5));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => (high - low) / size <= 5) || 10 * power;
    const found = [];
    for (let tick = Math.ceil(low / step - 1e-9); tick * step <= high * (1 + 1e-9) + 1e-12; tick++) {
      found.push(Number((tick * step).toPrecision(12)));
    }
    return found;
  };

  const path = (values, x, y) =>
    values.map((value, place) => `${place ? "L" : "M"}${x(place).toFixed(1)} ${y(value).toFixed(1)}`).join("");

  // Draw curves [{values, name}] of equally many values over a length in the unit of `across` into an <svg>.
  matest.chart = (svg, curves, length, across, upward) => {
    // Its own pixels, so that texts have the size of others.
    const width = svg.clientWidth || 640;
    const end = width - 8;
    const high = Math.max(1e-12, ...curves.flatMap((curve) => curve.values));
    const x = (place) => LEFT + ((end - LEFT) * place) / Math.max(curves[0].values.length - 1, 1);
    const y = (value) => BOTTOM - ((BOTTOM - TOP) * value) / high;
    const right = (distance) => LEFT + ((end - LEFT) * distance) / (length || 1);
    const { element, rounded } = matest;
    const parts = [];
    for (const tick of ticks(0, high)) {
      parts.push(element("path", { class: "grid", d: `M${LEFT} ${y(tick)}H${end}` }));
      parts.push(element("text", { x: LEFT - 6, y: y(tick) + 4, "text-anchor": "end" }, rounded(tick)));
    }
    for (const tick of ticks(0, length)) {
      parts.push(element("text", { x: right(tick), y: BOTTOM + 16, "text-anchor": "middle" }, rounded(tick)));
    }
    parts.push(element("text", { x: (LEFT + end) / 2, y: HEIGHT - 4, "text-anchor": "middle" }, across));
    const turned = `translate(12 ${(TOP + BOTTOM) / 2}) rotate(-90)`;
    parts.push(element("g", { transform: turned }, element("text", { "text-anchor": "middle" }, upward)));
    for (const curve of curves) {
      parts.push(element("path", { class: `curve ${curve.name}`, d: path(curve.values, x, y) }));
    }
    svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    svg.replaceChildren(...parts);
  };
})();
