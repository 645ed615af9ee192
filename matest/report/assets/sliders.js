// The controls of relighting: the light that is dragged over the object, and a slider for every parameter.
"use strict";

(async () => {
  const root = document.getElementById("relight");
  const data = matest.data("relight-data");
  if (root === null || data === null) return;

  const FARTHEST = (150 / 180) * Math.PI;
  const [canvas, lamp] = [root.querySelector("canvas"), root.querySelector(".lamp")];
  const form = root.querySelector("form");
  const { element, rounded, clamp } = matest;
  const [wide, high] = [data.width, data.height].map((side) => side / Math.min(data.width, data.height));
  const state = { values: [], polar: 0, azimuth: 0, brighter: 1 };
  const initial = (parameter) => (parameter.map === undefined ? [...parameter.value] : [1]);
  let draw = () => {};

  const direction = () => [
    Math.sin(state.polar) * Math.cos(state.azimuth),
    Math.sin(state.polar) * Math.sin(state.azimuth),
    Math.cos(state.polar),
  ];

  const update = () => {
    draw(direction(), state.values, state.brighter);
    const far = state.polar / (Math.PI / 2);
    lamp.style.left = `${50 + 50 * clamp((far * Math.cos(state.azimuth)) / wide, -1, 1)}%`;
    lamp.style.top = `${50 - 50 * clamp((far * Math.sin(state.azimuth)) / high, -1, 1)}%`;
    const degrees = (angle) => Math.round((angle * 180) / Math.PI);
    const around = (degrees(state.azimuth) + 360) % 360;
    const said = `Light ${degrees(state.polar)}° from the line of sight, ${around}° counterclockwise from the right.`;
    root.querySelector(".reading").textContent = said;
  };

  // The light at a place to the right of the middle and above it, in halves of the shorter side: there it is at 90°.
  const point = (x, y) => {
    state.polar = clamp((Math.hypot(x, y) * Math.PI) / 2, 0, FARTHEST);
    state.azimuth = Math.atan2(y, x);
    update();
  };

  const stand = ([x, y, z]) => {
    [state.polar, state.azimuth] = [Math.atan2(Math.hypot(x, y), z), Math.atan2(y, x)];
    update();
  };

  const spoken = (parameter, value) => {
    if (parameter.map !== undefined) return `× ${rounded(value)} of its map`;
    if (parameter.unit !== "rad") return rounded(value) + (parameter.unit === "1" ? "" : ` ${parameter.unit}`);
    return `${rounded(value)} rad, ${rounded((value * 180) / Math.PI)}°`;
  };

  // A slider between two ends, beside `output`, that calls `change` with its value; returns the input.
  const slider = (name, ends, value, log, output, said, change) => {
    const [to, from] = log ? [Math.log, Math.exp] : [Number, Number];
    const [min, max] = ends.map(to);
    const input = element("input", { type: "range", min, max, step: (max - min) / 400 || 1, "aria-label": name });
    input.value = to(value);
    if (min === max) input.disabled = true;
    const say = (value) => {
      output.textContent = said(value);
      // The number of a logarithmic slider means nothing to who listens.
      input.setAttribute("aria-valuetext", said(value));
    };
    say(value);
    input.addEventListener("input", () => {
      const chosen = from(Number(input.value));
      say(chosen);
      change(chosen);
      update();
    });
    return input;
  };

  const ofParameter = (parameter, number) => {
    const mapped = parameter.map !== undefined;
    const rows = initial(parameter).map((start, channel) => {
      const name = [parameter.name, mapped ? "" : parameter.channels[channel]].join(" ").trim();
      const output = element("output");
      const ends = mapped ? [0, 2] : [parameter.lower[channel], parameter.upper[channel]];
      const said = (value) => spoken(parameter, value);
      const input = slider(name, ends, start, parameter.log && !mapped, output, said, (value) => {
        state.values[number][channel] = value;
      });
      const known = mapped ? undefined : parameter.estimates[channel];
      return element("label", {}, element("b", {}, name), output, input, element("small", {}, known ? `estimate ${known}` : ""));
    });
    return element("fieldset", { title: parameter.meaning }, ...rows);
  };

  const controls = () => {
    state.values = data.parameters.map(initial);
    state.brighter = 1;
    const options = data.lights.map((light, number) => element("option", { value: number }, light.name));
    const lights = element("select", {}, element("option", { value: "" }, "by hand"), ...options);
    lights.addEventListener("change", () => lights.value !== "" && stand(data.lights[lights.value].direction));
    lights.value = "0";
    const reset = element("button", { type: "button" }, "as estimated");
    reset.addEventListener("click", () => {
      controls();
      stand(data.lights[0].direction);
    });
    const shown = element("output");
    const exposure = slider("exposure", [1 / 8, 8], 1, true, shown, (value) => `${rounded(value)}×`, (value) => {
      state.brighter = value;
    });
    form.replaceChildren(
      element("label", { class: "choice" }, element("b", {}, "light as in"), lights),
      element("label", {}, element("b", {}, "exposure"), shown, exposure),
      ...data.parameters.map(ofParameter),
      reset,
    );
    byHand = () => (lights.value = "");
  };
  let byHand = () => {};

  try {
    draw = await matest.relighter(canvas, document.getElementById("relight-shader").textContent, data);
  } catch (error) {
    root.replaceChildren(element("p", { class: "warning" }, `No relighting here: ${error.message}.`));
    return;
  }
  controls();
  stand(data.lights[0].direction);
  matest.drag(canvas, (x, y) => {
    byHand();
    point((2 * x - 1) * wide, (1 - 2 * y) * high);
  });
  canvas.addEventListener("pointerdown", () => canvas.focus());
  canvas.addEventListener("keydown", (event) => {
    const arrow = matest.arrow(event);
    if (arrow === null) return;
    byHand();
    const far = state.polar / (Math.PI / 2);
    point(far * Math.cos(state.azimuth) + arrow[0] / 30, far * Math.sin(state.azimuth) - arrow[1] / 30);
  });
  root.dataset.ready = "yes";
})();
