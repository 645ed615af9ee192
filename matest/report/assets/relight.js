// A material on the object's normals in a canvas, from the tables that relight.py wrote.
"use strict";

(() => {
  // The vectors of three channels: one value stands for all.
  const three = (values) => (values.length === 1 ? [values[0], values[0], values[0]] : values);

  const compiled = (gl, kind, source) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    return shader;
  };

  // A triangle that covers the canvas.
  const VERTICES = "#version 300 es\nvoid main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0, 1); }";

  const linked = (gl, source) => {
    const program = gl.createProgram();
    gl.attachShader(program, compiled(gl, gl.VERTEX_SHADER, VERTICES));
    gl.attachShader(program, compiled(gl, gl.FRAGMENT_SHADER, source));
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    gl.useProgram(program);
    return program;
  };

  const texture = (gl, program, name, unit, target, filter) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, gl.createTexture());
    gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, filter);
    for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) {
      gl.texParameteri(target, axis, gl.CLAMP_TO_EDGE);
    }
    gl.uniform1i(gl.getUniformLocation(program, name), unit);
  };

  // Tables of one or three channels as colours, one behind the other.
  const colours = async (data) => {
    const size = data.nodes[0] * data.nodes[1] * data.nodes[2];
    const codes = new Int16Array((await matest.unpacked(data.tables, data.nodes[0], 2)).buffer);
    const texels = new Float32Array(4 * size * data.channels.length);
    let start = 0;
    data.channels.forEach((channels, table) => {
      for (let place = 0; place < size; place++) {
        for (let colour = 0; colour < 3; colour++) {
          const code = codes[start + (channels === 1 ? 0 : colour * size) + place];
          texels[4 * (table * size + place) + colour] = data.step * code;
        }
      }
      start += channels * size;
    });
    return texels;
  };

  const normals = async (data) => {
    const codes = await matest.unpacked(data.normals, data.width, 2);
    const count = codes.length / 2;
    const texels = new Float32Array(4 * count);
    for (let place = 0; place < count; place++) {
      if (codes[place] === 0) continue;
      const [x, y] = [codes[place], codes[count + place]].map((code) => (2 * (code - 1)) / (data.normalSteps - 1) - 1);
      const z = Math.sqrt(Math.max(1 - x * x - y * y, 0));
      const length = Math.hypot(x, y, z);
      texels.set([x / length, y / length, z / length, 1], 4 * place);
    }
    return texels;
  };

  const maps = async (data) => {
    const mapped = data.parameters.filter((parameter) => parameter.map !== undefined);
    const count = data.width * data.height;
    const texels = new Float32Array(4 * count * Math.max(mapped.length, 1));
    for (const [layer, parameter] of mapped.entries()) {
      const codes = await matest.unpacked(parameter.map, data.width, 2);
      const channels = codes.length / count;
      for (let place = 0; place < 3 * count; place++) {
        const [pixel, colour] = [Math.floor(place / 3), place % 3];
        const code = codes[(channels === 1 ? 0 : colour * count) + pixel];
        texels[4 * (layer * count + pixel) + colour] = (code / data.mapSteps) * parameter.mapTop;
      }
    }
    return texels;
  };

  const upload = async (gl, program, data) => {
    texture(gl, program, "tables", 0, gl.TEXTURE_3D, gl.LINEAR);
    const [wide, high, deep] = [data.nodes[0], data.nodes[1], data.nodes[2] * data.channels.length];
    if (deep > gl.getParameter(gl.MAX_3D_TEXTURE_SIZE)) throw new Error("the model has too many tables for it");
    const tables = await colours(data);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.RGBA16F, wide, high, deep, 0, gl.RGBA, gl.FLOAT, tables);
    const across = await normals(data);
    texture(gl, program, "normals", 1, gl.TEXTURE_2D, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, data.width, data.height, 0, gl.RGBA, gl.FLOAT, across);
    const layers = await maps(data);
    texture(gl, program, "maps", 2, gl.TEXTURE_2D_ARRAY, gl.NEAREST);
    const depth = layers.length / (4 * data.width * data.height);
    gl.texImage3D(gl.TEXTURE_2D_ARRAY, 0, gl.RGBA32F, data.width, data.height, depth, 0, gl.RGBA, gl.FLOAT, layers);
  };

  const structure = (gl, at, data) => {
    const { terms, parameters } = data;
    let [factor, move] = [0, 0];
    const ranges = terms.flatMap((term) => [factor, (factor += term.factors.length), move, (move += term.moves.length)]);
    gl.uniform4iv(at("ranges"), ranges);
    gl.uniform1iv(at("bases"), terms.map((term) => term.base));
    gl.uniform1fv(at("units"), terms.map((term) => term.unit));
    if (factor) gl.uniform2iv(at("factors"), terms.flatMap((term) => term.factors.flat()));
    if (move) gl.uniform2iv(at("moves"), terms.flatMap((term) => term.moves.flat()));
    for (const [name, key] of [["middles", "value"], ["lowers", "lower"], ["uppers", "upper"]]) {
      gl.uniform3fv(at(name), parameters.flatMap((parameter) => three(parameter[key])));
    }
    gl.uniform1iv(at("logs"), parameters.map((parameter) => Number(parameter.log)));
    let layer = 0;
    gl.uniform1iv(at("layers"), parameters.map((parameter) => (parameter.map === undefined ? -1 : layer++)));
    gl.uniform3fv(at("nodes"), data.nodes);
    gl.uniform1i(at("terms"), terms.length);
    gl.uniform1i(at("reciprocal"), Number(data.reciprocal));
    gl.uniform1f(at("sideNodes"), data.sideNodes);
    gl.uniform1f(at("top"), data.top);
    gl.uniform1i(at("height"), data.height);
  };

  // A function that draws the material with some values [P][1 or 3] under a light [3]; `brighter` multiplies the exposure.
  matest.relighter = async (canvas, source, data) => {
    const gl = canvas.getContext("webgl2", { preserveDrawingBuffer: true, premultipliedAlpha: true, antialias: false });
    if (gl === null) throw new Error("the browser has no WebGL2");
    const count = (name) => data.terms.reduce((sum, term) => sum + term[name].length, 0);
    const sizes = { TERMS: data.terms.length, FACTORS: count("factors"), MOVES: count("moves") };
    sizes.PARAMETERS = data.parameters.length;
    const sized = source.trim().replace(/(const int ([A-Z]+) = )1;/g, (_, start, name) => `${start}${Math.max(sizes[name], 1)};`);
    const program = linked(gl, sized);
    const at = (name) => gl.getUniformLocation(program, name);
    await upload(gl, program, data);
    structure(gl, at, data);
    return (light, values, brighter) => {
      gl.uniform3fv(at("light"), light);
      gl.uniform3fv(at("exposed"), three(data.irradiance).map((power) => power * data.scale * brighter));
      gl.uniform3fv(at("values"), values.flatMap(three));
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    };
  };
})();
