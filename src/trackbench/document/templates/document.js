"use strict";
// A page is whole without this. It folds the menu on a phone, opens what is folded for printing, and adds to each
// figure zooming, and reading values off with a pointer.
const menu = document.querySelector("details.menu"), narrow = matchMedia("(max-width: 60rem)");
if (menu) {
  const fit = () => { menu.open = !narrow.matches; };
  fit();
  narrow.addEventListener("change", fit);
  menu.addEventListener("click", event => { if (narrow.matches && event.target.closest("a")) menu.open = false; });
}
addEventListener("beforeprint", () => document.querySelectorAll("details:not([open])").forEach(it => {
  it.open = true;
  it.dataset.folded = "";
}));
addEventListener("afterprint", () => document.querySelectorAll("[data-folded]").forEach(it => {
  it.open = false;
  delete it.dataset.folded;
}));

const readout = document.body.appendChild(document.createElement("div"));
readout.className = "readout";
readout.hidden = true;

function number(value) { return String(Number(value.toPrecision(3))); }

// "position RMSE, m" and 0.071 make "position RMSE 0.071 m".
function reading(label, value) {
  const [quantity, unit = ""] = label.split(", ").filter(part => !part.startsWith("log"));
  return `${quantity} ${number(value)}\u00a0${unit}`.trim();
}

// Points of what has a title, such as the line of a tracker: title, x, y and the element, which may be hidden.
function points(svg) {
  const found = [];
  for (const title of svg.querySelectorAll("title")) {
    const group = title.parentNode;
    for (const path of group.querySelectorAll("path[d]:not(defs path)"))
      for (const [, x, y] of path.getAttribute("d").matchAll(/(-?[\d.]+) (-?[\d.]+)/g))
        found.push([title.textContent, Number(x), Number(y), group]);
    for (const use of group.querySelectorAll("use"))
      found.push([title.textContent, Number(use.getAttribute("x")), Number(use.getAttribute("y")), group]);
  }
  svg.querySelectorAll("title").forEach(title => title.remove());
  return found;
}

for (const svg of document.querySelectorAll("svg.plot")) {
  const [, , width, height] = svg.getAttribute("viewBox").split(" ").map(Number);
  const panels = JSON.parse(svg.dataset.axes);
  let x = 0, y = 0, part = 1, titled;
  const show = () => {
    x = Math.min(Math.max(x, 0), width * (1 - part));
    y = Math.min(Math.max(y, 0), height * (1 - part));
    svg.setAttribute("viewBox", `${x} ${y} ${width * part} ${height * part}`);
    svg.classList.toggle("zoomed", part < 1);
  };
  const place = event => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  const zoom = (factor, at = {x: x + width * part / 2, y: y + height * part / 2}) => {
    const next = Math.min(1, Math.max(1 / 16, part / factor));
    x = at.x - (at.x - x) * next / part;
    y = at.y - (at.y - y) * next / part;
    part = next;
    show();
  };
  const pan = (dx, dy) => { x += dx * width * part; y += dy * height * part; show(); };
  const keys = {
    "+": () => zoom(1.5), "-": () => zoom(1 / 1.5), "0": () => zoom(0.01), ArrowLeft: () => pan(-0.1, 0),
    ArrowRight: () => pan(0.1, 0), ArrowUp: () => pan(0, -0.1), ArrowDown: () => pan(0, 0.1),
  };
  const tools = document.createElement("div");
  tools.className = "tools";
  for (const [text, name, key] of [["+", "Zoom in", "+"], ["\u2212", "Zoom out", "-"], ["\u21ba", "Whole figure", "0"]]) {
    const button = tools.appendChild(document.createElement("button"));
    button.type = "button";
    button.textContent = text;
    button.title = `${name} (${key}; arrows move)`;
    button.setAttribute("aria-label", name);
    button.addEventListener("click", keys[key]);
  }
  const figure = svg.closest("figure");
  figure.prepend(tools);
  figure.addEventListener("keydown", event => {
    if (event.ctrlKey || event.metaKey || !(event.key in keys) || (event.key.startsWith("Arrow") && part === 1)) return;
    event.preventDefault();
    keys[event.key]();
  });
  svg.addEventListener("wheel", event => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, place(event));
  }, {passive: false});
  svg.addEventListener("dblclick", event => zoom(2, place(event)));
  svg.addEventListener("pointermove", event => {
    if (event.buttons && part < 1) pan(-event.movementX / svg.clientWidth, -event.movementY / svg.clientHeight);
    say(event);
  });
  svg.addEventListener("pointerdown", event => { if (part < 1) svg.setPointerCapture(event.pointerId); say(event); });
  svg.addEventListener("pointerleave", () => { readout.hidden = true; });

  function say(event) {
    const at = place(event), reach = 12 * width * part / svg.clientWidth;
    let name = "", nearest = reach, to = at;
    titled ??= points(svg);
    for (const [title, px, py, group] of titled) {
      const distance = Math.hypot(px - at.x, py - at.y);
      if (distance < nearest && group.checkVisibility()) [name, nearest, to] = [title, distance, {x: px, y: py}];
    }
    const panel = panels.find(it => it.left <= to.x && to.x <= it.right && it.top <= to.y && to.y <= it.bottom);
    const values = panel ? [
      along(panel.x, (to.x - panel.left) / (panel.right - panel.left)),
      along(panel.y, (panel.bottom - to.y) / (panel.bottom - panel.top)),
    ] : [];
    const text = [name, ...values].filter(Boolean).join("; ");
    readout.hidden = !text;
    readout.textContent = text;
    readout.style.left = `${Math.min(event.clientX + 12, innerWidth - readout.offsetWidth - 8)}px`;
    readout.style.top = `${event.clientY > 60 ? event.clientY - readout.offsetHeight - 12 : event.clientY + 20}px`;
  }
}

// The value at a share of an axis: its label, ends, and whether it is logarithmic.
function along([label, low, high, log], share) {
  if (!label) return "";
  return reading(label, log ? low * (high / low) ** share : low + (high - low) * share);
}
