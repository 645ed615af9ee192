// Numbers that packing.py wrote into the page, and small helpers for its other scripts.
"use strict";

const matest = {};

// What a data block holds; null where the page has none.
matest.data = (id) => {
  const block = document.getElementById(id);
  return block === null ? null : JSON.parse(block.textContent);
};

// Unsigned integers of 1 or 2 bytes from text: see packing.py. `row` is the length of a row.
matest.unpacked = async (text, row, bytes) => {
  const compressed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([compressed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const count = planes.length / bytes;
  const codes = bytes === 1 ? new Uint8Array(count) : new Uint16Array(count);
  for (let place = 0; place < count; place++) {
    const difference = planes[place] + (bytes === 1 ? 0 : planes[count + place] << 8);
    // Typed arrays wrap round, as the differences did.
    codes[place] = difference + (place % row === 0 ? 0 : codes[place - 1]);
  }
  return codes;
};

// An element with attributes and children, which are elements or plain text.
matest.element = (name, attributes = {}, ...children) => {
  const drawn = ["svg", "path", "circle", "line", "text", "g"].includes(name);
  const made = drawn ? document.createElementNS("http://www.w3.org/2000/svg", name) : document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.append(...children);
  return made;
};

// Follow a pointer that is held down on an element: `move` gets its place from the corner as shares of the size.
matest.drag = (element, move) => {
  const at = (event) => {
    const box = element.getBoundingClientRect();
    move((event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height, event.type === "pointerdown");
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    element.setPointerCapture(event.pointerId);
    event.preventDefault();
    at(event);
  });
  element.addEventListener("pointermove", (event) => {
    if (element.hasPointerCapture(event.pointerId)) at(event);
  });
};

// Steps right and down of an arrow key; null for other keys.
matest.arrow = (event) => {
  const step = event.shiftKey ? 5 : 1;
  const steps = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
  if (steps === undefined) return null;
  event.preventDefault();
  return steps;
};

// A number with three digits.
matest.rounded = (value) => (value === 0 ? "0" : String(Number(value.toPrecision(3))));

matest.clamp = (value, low, high) => Math.min(Math.max(value, low), high);
