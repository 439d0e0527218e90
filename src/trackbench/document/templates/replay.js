"use strict";
// Plays the scene inside each element of class "replay". Without this script the figure is a still picture.
{
  // Time for which a trail, a measurement and an event's mark are shown, s; longest gap within a line of errors, s.
  const TRAIL = 2, SEEN = .3, MARKED = 1, GAP = 1;
  // Height of a view that follows a vehicle, m; scale from which the whole scene is shown, pixels per metre.
  const NEAR = 28, LEGIBLE = 7;
  const SAME = 5e-4;  // Times are rounded to milliseconds.

  const series = ({ quantum, order, differences }) => {
    const values = Float64Array.from(differences);
    for (; order; order--) for (let i = 1; i < values.length; i++) values[i] += values[i - 1];
    return values.map(count => count * quantum);
  };

  const unpack = async text => {
    const bytes = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
    return JSON.parse(await new Response(stream).text(), (key, value) => value?.quantum ? series(value) : value);
  };

  // Returns the index of the last time up to t, or -1.
  const latest = (times, t) => {
    let low = -1, high = times.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t + SAME) low = middle; else high = middle;
    }
    return low;
  };

  const nearest = (times, t) => {
    const i = Math.max(0, latest(times, t));
    return i + 1 < times.length && times[i + 1] - t < t - times[i] ? times[i + 1] : times[i];
  };

  // Returns a path's values at a time, interpolated linearly between two instants; null in a gap.
  const stateAt = (path, t) => {
    const i = latest(path.time, t);
    if (i < 0) return null;
    const past = t - path.time[i] > SAME;
    if (past && !(path.time[i + 1] - path.time[i] <= path.gap)) return null;
    const share = past ? (t - path.time[i]) / (path.time[i + 1] - path.time[i]) : 0;
    const state = { last: i };
    for (const name of ["x", "y", "heading", "a", "b", "c"]) {
      const values = path[name];
      if (values) state[name] = values[i] + (share && share * (values[i + 1] - values[i]));
    }
    return state;
  };

  class Player {
    constructor(box, scene) {
      this.box = box;
      this.scene = scene;
      this.start = scene.start?.time_s ?? 0;
      [this.above, this.line] = box.querySelectorAll("canvas");
      this.control = name => box.querySelector(`[name="${name}"]`);
      for (const path of scene.paths) {
        const steps = path.time.slice(1).map((time, i) => time - path.time[i]).sort();
        path.gap = Math.max(.5, 2.5 * (steps[steps.length >> 1] ?? 0));
      }
      this.instants = [...new Set(scene.paths.flatMap(path => [...path.time]))].sort((a, b) => a - b);
      this.vehicles = scene.paths.filter(path => !path.tracker);
      this.trackers = new Map(scene.trackers.map((tracker, i) => {
        const label = box.querySelectorAll("label.tracker")[i];
        return [tracker.name, { ...tracker, label, chosen: label.querySelector("input"), value: label.querySelector("output") }];
      }));
      this.first = this.instants[0];
      this.end = this.instants.at(-1);
      this.time = nearest(this.instants, this.start);
      this.pan = [0, 0];
      this.control("follow").append(...this.vehicles.filter(path => path.name).map(path => new Option(path.name)));
      box.hidden = false;
      this.follow(this.wholeAcross() > this.above.clientWidth / LEGIBLE ? scene.start?.path : "");
      this.listen();
    }

    listen() {
      const { box, above, line, scene } = this, redraw = () => this.draw();
      this.control("play").onclick = () => this.toggle();
      this.control("worst").hidden = !scene.start;
      this.control("worst").onclick = () => this.seek(this.start);
      this.control("follow").onchange = event => this.follow(event.target.value);
      this.control("closer").onclick = () => this.zoom(1.25);
      this.control("farther").onclick = () => this.zoom(.8);
      this.control("full").onclick = () => document.fullscreenElement ? document.exitFullscreen() : box.requestFullscreen();
      box.onkeydown = event => this.key(event);
      line.onpointerdown = line.onpointermove = event => {
        if (event.type == "pointerdown") line.setPointerCapture(event.pointerId);
        else if (!line.hasPointerCapture(event.pointerId)) return;
        this.stop();
        const at = this.timeOf(event.offsetX), near = 6 / this.axis.perSecond;
        const close = this.shownEvents().find(it => Math.abs(it.time_s - at) < near);
        this.seek(close ? close.time_s : at);
      };
      above.onpointerdown = event => above.setPointerCapture(event.pointerId);
      above.onpointermove = event => {
        if (!above.hasPointerCapture(event.pointerId)) return;
        this.pan[0] -= event.movementX / this.view.scale;
        this.pan[1] += event.movementY / this.view.scale;
        this.draw();
      };
      new ResizeObserver(redraw).observe(above);
      // Checkboxes of this replay, and checkboxes that hide a tracker in every figure of the page.
      document.addEventListener("change", redraw);
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
      addEventListener("beforeprint", () => { box.classList.add("paper"); this.draw(); });
      addEventListener("afterprint", () => { box.classList.remove("paper"); this.draw(); });
    }

    key(event) {
      const inside = event.target.localName, step = event.shiftKey ? "event" : "instant";
      if (inside == "select" || event.key == " " && inside != "canvas" && inside != "div") return;
      const act = {
        " ": () => this.toggle(),
        ArrowLeft: () => this.step(-1, step), ArrowRight: () => this.step(1, step),
        Home: () => this.seek(this.first), End: () => this.seek(this.end),
        "+": () => this.zoom(1.25), "=": () => this.zoom(1.25), "-": () => this.zoom(.8),
      }[event.key];
      if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      act();
    }

    // Time

    toggle() {
      if (this.playing) return this.stop();
      if (this.time >= this.end) this.time = this.first;
      const play = this.playing = {};
      let before = null;
      const frame = now => {
        if (this.playing != play) return;
        this.time += (before === null ? 0 : Math.min(now - before, 1000) / 1000) * this.control("speed").value;
        before = now;
        if (this.time >= this.end) return this.seek(this.end);
        this.draw();
        requestAnimationFrame(frame);
      };
      requestAnimationFrame(frame);
      this.draw();
    }

    stop() {
      if (this.playing) this.seek(this.time);
    }

    seek(time) {
      this.playing = null;
      this.time = nearest(this.instants, time);
      this.draw();
    }

    step(by, to) {
      const times = to == "event" ? [...new Set(this.shownEvents().map(it => it.time_s))].sort((a, b) => a - b) : this.instants;
      const i = latest(times, this.time), onIt = i >= 0 && this.time - times[i] <= SAME;
      this.seek(times[by > 0 ? i + 1 : onIt ? i - 1 : i] ?? this.time);
    }

    // View

    isShown(name) {
      const tracker = this.trackers.get(name);
      return tracker.chosen.checked && getComputedStyle(tracker.label.parentElement).display != "none";
    }

    shownEvents() {
      return this.scene.events.filter(it => this.isShown(it.tracker));
    }

    wholeAcross() {
      const [[left, right], [bottom, top]] = this.scene.range, { clientWidth, clientHeight } = this.above;
      return Math.max(right - left, (top - bottom) * clientWidth / clientHeight);
    }

    follow(name) {
      this.followed = this.vehicles.find(path => name && path.name == name);
      this.control("follow").value = this.followed ? name : "";
      const { clientWidth, clientHeight } = this.above, near = NEAR * clientWidth / clientHeight;
      this.across = this.followed ? Math.min(near, this.wholeAcross()) : this.wholeAcross();
      this.pan = [0, 0];
      this.draw();
    }

    zoom(by) {
      this.across = Math.min(Math.max(this.across / by, 4), 4 * this.wholeAcross());
      this.draw();
    }

    // Returns the middle of the view: the followed vehicle or its last position, moved so that the view stays in the scene.
    middle() {
      const path = this.followed, { clientWidth, clientHeight } = this.above;
      const at = path && (stateAt(path, this.time) ?? { last: Math.max(0, latest(path.time, this.time)) });
      return ["x", "y"].map((axis, i) => {
        const [low, high] = this.scene.range[i], half = (i ? clientHeight / clientWidth : 1) * this.across / 2;
        if (!path || high - low < 2 * half) return (low + high) / 2;
        return Math.min(Math.max(at[axis] ?? path[axis][at.last], low + half), high - half);
      });
    }

    // Drawing

    draw() {
      const style = getComputedStyle(this.box);
      this.colour = name => style.getPropertyValue(`--${name}`);
      this.font = size => `${size}px ${style.getPropertyValue("--font")}`;
      this.shown = new Set([...this.trackers.keys()].filter(name => this.isShown(name)));
      this.drawScene(this.cleared(this.above));
      this.drawLine(this.cleared(this.line));
      this.control("play").textContent = this.playing ? "Pause" : "Play";
      for (const [name, { value }] of this.trackers) {
        const error = this.errorOf(name);
        value.textContent = error === null ? "" : `${error.toFixed(2)} ${this.scene.unit}`;
      }
      const events = this.shownEvents().filter(it => Math.abs(it.time_s - this.time) <= SAME);
      this.box.querySelector(".told").textContent = events.map(it => `${it.tracker}: ${it.text}`).join("; ");
      this.line.setAttribute("aria-valuemin", this.first);
      this.line.setAttribute("aria-valuemax", this.end);
      this.line.setAttribute("aria-valuenow", this.time.toFixed(2));
      this.line.setAttribute("aria-valuetext", `${this.time.toFixed(2)} s`);
      const { x, y, scale } = this.view;
      Object.assign(this.box.dataset, { time: this.time.toFixed(3), view: [x, y, scale].join(" "), playing: !!this.playing });
    }

    cleared(canvas) {
      const sharp = devicePixelRatio || 1, { clientWidth, clientHeight } = canvas;
      canvas.width = Math.round(clientWidth * sharp);
      canvas.height = Math.round(clientHeight * sharp);
      const pen = canvas.getContext("2d");
      pen.scale(sharp, sharp);
      pen.lineJoin = "round";
      return pen;
    }

    drawScene(pen) {
      const { clientWidth: width, clientHeight: height } = this.above, scale = width / this.across;
      const [x, y] = this.middle().map((at, i) => at + this.pan[i]);
      this.view = { x, y, scale, at: (px, py) => [width / 2 + (px - x) * scale, height / 2 - (py - y) * scale] };
      const stroke = (xs, ys) => {
        pen.beginPath();
        xs.forEach((px, i) => pen.lineTo(...this.view.at(px, ys[i])));
        pen.stroke();
      };
      Object.assign(pen, { strokeStyle: this.colour("edge"), lineWidth: 1.5 });
      for (const lane of this.scene.lanes) stroke(lane.x, lane.y);
      for (const path of this.vehicles) this.drawTrail(pen, path, 3, .35);
      for (const path of this.vehicles) this.drawVehicle(pen, path);
      for (const of of this.scene.measurements) this.drawMeasurements(pen, of);
      for (const path of this.scene.paths) if (this.shown.has(path.tracker)) this.drawEstimate(pen, path);
      this.drawMarks(pen);
      this.drawScale(pen, height);
      pen.fillStyle = this.colour("ink");
      pen.font = `600 ${this.font(15)}`;
      pen.fillText(`${this.time.toFixed(2)} s`, 8, 18);
    }

    drawVehicle(pen, path) {
      const state = stateAt(path, this.time);
      if (!state) return;
      const { scale } = this.view, [px, py] = this.view.at(state.x, state.y);
      const [length, width] = path.size.map(side => side * scale);
      Object.assign(pen, { strokeStyle: path.colour, fillStyle: path.colour, lineWidth: 1.5 });
      pen.save();
      pen.translate(px, py);
      if (state.heading === undefined) {
        pen.beginPath();
        pen.arc(0, 0, 4, 0, 2 * Math.PI);
        pen.fill();
      } else {
        pen.rotate(-state.heading);
        pen.globalAlpha = .25;
        pen.fillRect(-length / 2, -width / 2, length, width);
        // The filled front shows the heading.
        pen.globalAlpha = .7;
        pen.fillRect(.36 * length, -width / 2, .14 * length, width);
        pen.globalAlpha = 1;
        pen.strokeRect(-length / 2, -width / 2, length, width);
      }
      pen.restore();
      const turned = state.heading ?? 0, reach = (length * Math.abs(Math.sin(turned)) + width * Math.abs(Math.cos(turned))) / 2;
      Object.assign(pen, { fillStyle: this.colour("muted"), font: this.font(11), textAlign: "center" });
      pen.fillText(path.name, px, py + reach + 12);
      pen.textAlign = "start";
    }

    drawMeasurements(pen, of) {
      for (let i = latest(of.time, this.time); i >= 0 && this.time - of.time[i] < SEEN; i--) {
        const [px, py] = this.view.at(of.x[i], of.y[i]), fresh = 1 - (this.time - of.time[i]) / SEEN;
        pen.strokeStyle = pen.fillStyle = of.false[i] ? this.colour("muted") : of.colour;
        pen.globalAlpha = .3 + .7 * fresh;
        pen.beginPath();
        if (of.false[i]) {
          pen.lineWidth = 1.25;
          pen.moveTo(px - 3, py);
          pen.lineTo(px + 3, py);
          pen.moveTo(px, py - 3);
          pen.lineTo(px, py + 3);
          pen.stroke();
          continue;
        }
        pen.arc(px, py, 2, 0, 2 * Math.PI);
        pen.fill();
        pen.globalAlpha = .6 * fresh;
        if (of.a) this.drawEllipse(pen, px, py, of.a[i], of.b[i], of.c[i], 1);
      }
      pen.globalAlpha = 1;
    }

    drawEstimate(pen, path) {
      const state = stateAt(path, this.time), { dashed } = this.trackers.get(path.tracker);
      this.drawTrail(pen, path, 1.25, .9);
      if (!state) return;
      const [px, py] = this.view.at(state.x, state.y);
      pen.strokeStyle = pen.fillStyle = path.colour;
      if (dashed) pen.setLineDash([4, 2]);
      if (path.a) this.drawEllipse(pen, px, py, state.a, state.b, state.c, 1.5);
      pen.setLineDash([]);
      pen.beginPath();
      pen.arc(px, py, 2.5, 0, 2 * Math.PI);
      pen.fill();
      pen.font = this.font(11);
      if (path.name) pen.fillText(path.name, px + 5, py - 5);
    }

    drawTrail(pen, path, width, alpha) {
      const { time, x, y } = path, now = stateAt(path, this.time);
      Object.assign(pen, { strokeStyle: path.colour, lineWidth: width, globalAlpha: alpha });
      pen.beginPath();
      let before = -Infinity;
      for (let i = latest(time, this.time - TRAIL) + 1; i < time.length && time[i] <= this.time + SAME; i++) {
        pen[time[i] - before > path.gap ? "moveTo" : "lineTo"](...this.view.at(x[i], y[i]));
        before = time[i];
      }
      if (now && before > -Infinity) pen.lineTo(...this.view.at(now.x, now.y));
      pen.stroke();
      pen.globalAlpha = 1;
    }

    drawEllipse(pen, px, py, a, b, c, width) {
      const { scale } = this.view;
      pen.save();
      pen.transform(a * scale, -b * scale, 0, -c * scale, px, py);
      pen.beginPath();
      pen.arc(0, 0, 1, 0, 2 * Math.PI);
      pen.restore();
      pen.lineWidth = width;
      pen.stroke();
    }

    // Marks: a ring for the largest error, lost or merged; a cross for a switch; a triangle for a new false track.
    drawMark(pen, { kind, tracker }, px, py, size) {
      Object.assign(pen, { strokeStyle: this.trackers.get(tracker).colour, lineWidth: 2 });
      pen.beginPath();
      if (kind == "switched") {
        pen.moveTo(px - size, py - size);
        pen.lineTo(px + size, py + size);
        pen.moveTo(px - size, py + size);
        pen.lineTo(px + size, py - size);
      } else if (kind == "false") {
        pen.moveTo(px, py - size);
        pen.lineTo(px + size, py + size);
        pen.lineTo(px - size, py + size);
        pen.closePath();
      } else pen.arc(px, py, size, 0, 2 * Math.PI);
      pen.stroke();
    }

    drawMarks(pen) {
      for (const it of this.shownEvents())
        if (Math.abs(it.time_s - this.time) <= MARKED / 2) this.drawMark(pen, it, ...this.view.at(it.x_m, it.y_m), 13);
    }

    drawScale(pen, height) {
      const length = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find(m => m * this.view.scale >= 40) ?? 2000;
      Object.assign(pen, { strokeStyle: this.colour("ink"), fillStyle: this.colour("ink"), lineWidth: 2, font: this.font(11) });
      pen.beginPath();
      pen.moveTo(10, height - 10);
      pen.lineTo(10 + length * this.view.scale, height - 10);
      pen.stroke();
      pen.fillText(`${length} m`, 10, height - 16);
    }

    // Time line: the error of each shown tracker, with the events above

    errorOf(name) {
      const line = this.scene.lines.find(it => it.tracker == name), i = line ? latest(line.time, this.time) : -1;
      return i >= 0 && this.time - line.time[i] < GAP ? line.value[i] : null;
    }

    timeOf(x) {
      return this.first + (x - this.axis.left) / this.axis.perSecond;
    }

    // Returns the end of the axis: it includes the worst moment, and cuts off a start or a single bad instant.
    topOf(lines) {
      const tops = lines.map(({ time, value }) => {
        const sorted = value.slice().sort(), i = latest(time, this.start);
        return Math.max(1.2 * (sorted[Math.floor(.97 * sorted.length)] ?? 0), 1.1 * (i < 0 ? 0 : value[i]));
      });
      return Math.max(...tops, 1e-3);
    }

    drawLine(pen) {
      const { clientWidth: width, clientHeight: height } = this.line, left = 8, top = 30, bottom = height - 18;
      const perSecond = (width - 2 * left) / Math.max(this.end - this.first, 1e-9);
      this.axis = { left, perSecond };
      const lines = this.scene.lines.filter(it => this.shown.has(it.tracker)), high = this.topOf(lines);
      const at = time => left + (time - this.first) * perSecond, up = value => bottom - value / high * (bottom - top);
      Object.assign(pen, { fillStyle: this.colour("muted"), strokeStyle: this.colour("edge"), lineWidth: 1, font: this.font(11) });
      pen.fillText(lines.length ? `${this.scene.quantity}, 0 to ${high.toPrecision(2)} ${this.scene.unit}` : "", left, 11);
      const tick = [.5, 1, 2, 5, 10, 20, 60, 120, 300, 600].find(s => s * perSecond >= 45) ?? 3600;
      pen.textAlign = "center";
      pen.beginPath();
      for (let time = Math.ceil(this.first / tick) * tick; time <= this.end + SAME; time += tick) {
        pen.moveTo(at(time), top);
        pen.lineTo(at(time), bottom);
        pen.fillText(`${time}`, Math.min(at(time), width - 12), height - 5);
      }
      pen.moveTo(left, bottom);
      pen.lineTo(width - left, bottom);
      pen.stroke();
      pen.save();
      pen.beginPath();
      pen.rect(0, top - 2, width, bottom - top + 3);
      pen.clip();
      for (const { tracker, time, value } of lines) {
        const { colour, dashed } = this.trackers.get(tracker);
        Object.assign(pen, { strokeStyle: colour, lineWidth: 1.5 });
        pen.setLineDash(dashed ? [5, 3] : []);
        pen.beginPath();
        time.forEach((t, i) => pen[i && t - time[i - 1] <= GAP ? "lineTo" : "moveTo"](at(t), up(value[i])));
        pen.stroke();
      }
      pen.restore();
      for (const it of this.shownEvents()) this.drawMark(pen, it, at(it.time_s), 21, 4);
      Object.assign(pen, { strokeStyle: this.colour("ink"), fillStyle: this.colour("ink"), lineWidth: 1.5 });
      pen.beginPath();
      pen.moveTo(at(this.time), 14);
      pen.lineTo(at(this.time), bottom);
      pen.stroke();
    }
  }

  // An older browser keeps the still picture.
  const boxes = "DecompressionStream" in window ? document.querySelectorAll(".replay") : [];
  for (const box of boxes) {
    const figure = box.closest("figure");
    unpack(figure.querySelector("script").textContent).then(scene => {
      new Player(box, scene);
      figure.querySelector("details.still").open = false;
    });
  }
}
