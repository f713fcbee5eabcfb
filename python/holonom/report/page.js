// Cursor and zoom of the figures, and the 3-D view: what this page can do beyond paper.
"use strict";
(() => {
  const RIGHT = 10, TOP = 5, BOTTOM = 34;
  /** Pixels of a column; where a curve turns back this often in one, its range is drawn. */
  const COLUMN = 2, TURNS = 2, AROUND = 3;
  const SUPERSCRIPT = { "-": "⁻", 0: "⁰", 1: "¹", 2: "²", 3: "³", 4: "⁴", 5: "⁵", 6: "⁶", 7: "⁷", 8: "⁸", 9: "⁹" };
  const figures = [];
  let view = null, whole = null, cursor = null, frame = null, stepped = 0;

  const safe = (text) => text.replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`);
  const signed = (text) => text.replace(/-/g, "−");
  const power = (exponent) => "10" + String(exponent).replace(/./g, (c) => SUPERSCRIPT[c]);

  async function unpacked(id) {
    const element = document.getElementById(id);
    if (!element || !window.DecompressionStream) return null;
    const bytes = Uint8Array.from(atob(element.textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).arrayBuffer();
  }

  // --- numbers along axes

  function linear(low, high, most) {
    const size = 10 ** Math.floor(Math.log10((high - low) / most));
    const step = [1, 2, 2.5, 5, 10, 20].map((k) => k * size).find((s) => Math.floor(high / s + 1e-9) - Math.ceil(low / s - 1e-9) < most) || 50 * size;
    const values = [];
    for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k++) values.push(k * step);
    const largest = Math.max(...values.map(Math.abs), 0);
    let exponent = largest ? Math.floor(Math.log10(largest)) : 0;
    exponent = exponent > -4 && exponent < 5 ? 0 : exponent - (((exponent % 3) + 3) % 3);
    const unit = 10 ** exponent;
    let decimals = Math.max(0, -Math.floor(Math.log10(step / unit) + 1e-9));
    if (Math.abs((step / unit) * 10 ** decimals - Math.round((step / unit) * 10 ** decimals)) > 1e-6) decimals++;
    const labels = values.map((v) => signed((Math.abs(v) < 1e-9 * step ? 0 : v / unit).toFixed(Math.min(decimals, 12))));
    return { values, labels, scale: exponent ? `×${power(exponent)}` : "" };
  }

  function logarithmic(low, high, most) {
    const first = Math.ceil(Math.log10(low) - 1e-9), last = Math.floor(Math.log10(high) + 1e-9);
    if (last - first < 1) {
      const ticks = linear(low, high, most);
      return { ...ticks, values: ticks.values.filter((v) => v > 0), labels: ticks.labels.filter((_, k) => ticks.values[k] > 0) };
    }
    const every = Math.ceil((last - first + 1) / most);
    const values = [], labels = [];
    for (let k = first; k <= last; k++) {
      if (k % every) continue;
      values.push(10 ** k);
      labels.push(power(k));
    }
    return { values, labels, scale: "" };
  }

  function told(value, span) {
    if (!Number.isFinite(value)) return "–";
    const size = Math.abs(value);
    if (size <= 1e-9 * span) return "0";
    if (size >= 1e6 || size < 1e-4) {
      const [digits, exponent] = value.toExponential(3).split("e");
      return signed(`${digits}×${power(Number(exponent))}`);
    }
    const digits = Math.max(0, Math.min(7, 4 - Math.floor(Math.log10(Math.max(span, 1e-6 * size) || 1))));
    return signed(value.toFixed(digits));
  }

  /** A time, of a span of so many seconds. */
  const moment = (time, span) => time.toFixed(Math.max(0, Math.min(12, 4 - Math.floor(Math.log10(span)))));

  // --- lines

  /** First index whose value is not below. */
  function place(values, wanted) {
    let low = 0, high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] < wanted) low = middle + 1;
      else high = middle;
    }
    return low;
  }

  function valueAt(line, x) {
    const k = place(line.x, x), n = line.x.length;
    if (!n || x < line.x[0] || x > line.x[n - 1]) return NaN;
    if (k === 0) return line.base + line.y[0];
    if (leaps(line, k)) return line.base + line.y[k];
    const part = (x - line.x[k - 1]) / (line.x[k] - line.x[k - 1] || 1);
    return line.base + line.y[k - 1] + part * (line.y[k] - line.y[k - 1]);
  }

  function seen(line, [from, to]) {
    return [Math.max(0, place(line.x, from) - 1), Math.min(line.x.length - 1, place(line.x, to))];
  }

  /** Whether an angle jumps by a whole turn before a point. */
  function leaps(line, k) {
    return line.wraps && k > 0 && Math.abs(line.y[k] - line.y[k - 1]) > Math.PI;
  }

  function polyline(line, first, last, px, py) {
    let path = "", joined = false;
    for (let k = first; k <= last; k++) {
      const y = py(line.base + line.y[k]);
      if (!Number.isFinite(y)) joined = false;
      else {
        path += `${joined && !leaps(line, k) ? "L" : "M"}${px(line.x[k]).toFixed(1)} ${y.toFixed(1)}`;
        joined = true;
      }
    }
    return { path, band: "" };
  }

  /** A line of more points than pixels: extremes of each column, or its range where it is dense. */
  function reduced(line, first, last, px, py, left, width) {
    const count = Math.max(1, Math.floor(width / COLUMN));
    const columns = Array.from({ length: count }, () => ({ low: NaN, high: NaN, turns: 0, leaps: 0, sum: 0, n: 0, points: [] }));
    let before = NaN, way = 0, top = Infinity, bottom = -Infinity;
    for (let k = first; k <= last; k++) {
      const y = py(line.base + line.y[k]);
      if (!Number.isFinite(y)) return polyline(line, first, last, px, py);
      top = Math.min(top, y);
      bottom = Math.max(bottom, y);
    }
    for (let k = first; k <= last; k++) {
      const x = px(line.x[k]), y = py(line.base + line.y[k]);
      const column = columns[Math.min(count - 1, Math.max(0, Math.floor((x - left) / COLUMN)))];
      const rise = Math.abs(y - before) > 1e-3 * (bottom - top) ? Math.sign(y - before) : 0;
      if (rise) {
        if (way && rise !== way) column.turns++;
        way = rise;
      }
      before = y;
      column.leaps += k > first && leaps(line, k) ? 1 : 0;
      column.n++;
      column.sum += y;
      const points = column.points;
      if (!points.length) points.push([x, y], [x, y], [x, y], [x, y]);
      else {
        if (y < points[1][1]) points[1] = [x, y];
        if (y > points[2][1]) points[2] = [x, y];
        points[3] = [x, y];
      }
    }
    const thick = (c) => c.n && c.turns >= TURNS && c.points[2][1] - c.points[1][1] > 0.01 * (bottom - top);
    let dense = columns.map((c) => Boolean(thick(c)));
    dense = dense.map((d, k) => d || Boolean(dense[k - 1] && dense[k + 1] && columns[k].n));
    dense = dense.map((d, k) => d && Boolean(dense[k - 1] || dense[k + 1]));
    if (dense.filter(Boolean).length < 4) dense.fill(false);
    let path = "", band = "", run = [], joined = false;
    const close = () => {
      if (run.length) {
        const upper = run.map(([x, c]) => `${x.toFixed(1)} ${c.points[1][1].toFixed(1)}`);
        const lower = run.reverse().map(([x, c]) => `${x.toFixed(1)} ${c.points[2][1].toFixed(1)}`);
        band += `M${upper.join("L")}L${lower.join("L")}Z`;
      }
      run = [];
    };
    columns.forEach((column, k) => {
      if (!column.n) return;
      if (dense[k]) {
        const x = left + (k + 0.5) * COLUMN;
        let sum = 0, n = 0, jumps = 0;
        for (let i = Math.max(0, k - AROUND); i <= Math.min(count - 1, k + AROUND); i++) {
          sum += columns[i].sum;
          n += columns[i].n;
          jumps += columns[i].leaps;
        }
        if (!jumps) path += `${joined ? "L" : "M"}${x.toFixed(1)} ${(sum / n).toFixed(1)}`;
        joined = !jumps; // a mean over jumps of an angle says nothing
        run.push([x, column]);
      } else {
        close();
        const [a, b, c, d] = column.points;
        if (column.leaps) joined = false;
        for (const [x, y] of [a, ...(b[0] < c[0] ? [b, c] : [c, b]), d]) {
          path += `${joined ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`;
          joined = !column.leaps;
        }
      }
    });
    close();
    return { path, band };
  }

  const SIGNS = { circle: "M-2.6 0a2.6 2.6 0 1 0 5.2 0a2.6 2.6 0 1 0-5.2 0z", cross: "M-2.6-2.6l5.2 5.2m-5.2 0l5.2-5.2" };

  // --- figures

  class Figure {
    constructor(root, data, number) {
      Object.assign(this, data, { root, number });
      this.timed = data.label === "time, s";
      this.box = root.querySelector(".drawing");
      const xs = this.panels.flatMap((p) => p.lines.filter((l) => l.x.length).map((l) => [l.x[0], l.x[l.x.length - 1]]));
      this.span = xs.length ? [Math.min(...xs.map((e) => e[0])), Math.max(...xs.map((e) => e[1]))] : [0, 1];
      this.axes = [];
    }

    build() {
      this.box.textContent = "";
      this.box.tabIndex = 0;
      this.axes = this.panels.map((panel) => {
        const head = document.createElement("div");
        head.className = "head";
        const keys = panel.lines.map((line) => `<span class="key${panel.lines.length === 1 && !line.label ? " alone" : ""}" style="--c:${safe(line.color || "currentColor")}">${safe(line.label)}<output></output></span>`);
        head.innerHTML =
          (panel.title ? `<b>${safe(panel.title)}</b>` : "") + `<i class="unit"></i>` + (panel.note ? `<i>${safe(panel.note)}</i>` : "") + keys.join("");
        const axes = document.createElement("div");
        axes.className = "axes";
        axes.innerHTML = '<div class="picture"></div><div class="cursor"></div><div class="chosen"></div>';
        this.box.append(head, axes);
        return { panel, head, axes, picture: axes.firstChild, cursor: axes.children[1], chosen: axes.children[2], outputs: head.querySelectorAll("output") };
      });
      for (const one of this.axes) this.listen(one);
      this.box.addEventListener("keydown", (event) => this.key(event));
    }

    range() {
      return this.timed && view ? view : this.span;
    }

    draw() {
      const width = this.box.clientWidth;
      if (!width) return;
      if (!this.axes.length) this.build();
      const [from, to] = this.range();
      const height = Math.round(Math.max(104, Math.min(220, this.height * Math.min(width, 640))));
      const scales = this.axes.map(({ panel }) => this.scale(panel, [from, to], height));
      const left = Math.max(34, ...scales.flatMap((s) => s.ticks.labels.map((l) => 8 + 6.7 * l.length)));
      this.left = left;
      this.inner = Math.max(20, width - left - RIGHT);
      const px = (x) => left + ((x - from) / (to - from || 1)) * this.inner;
      const across = linear(from, to, Math.max(2, Math.floor(this.inner / 80)));
      this.axes.forEach((one, k) => {
        const { panel } = one, { low, high, ticks } = scales[k];
        const logs = panel.log;
        const py = (y) => {
          const part = logs ? (y > 0 ? Math.log(y / low) / Math.log(high / low) : NaN) : (y - low) / (high - low);
          return TOP + height - part * height;
        };
        const last = k === this.axes.length - 1;
        const floor = TOP + height;
        const grid = across.values.map((x) => `M${px(x).toFixed(1)} ${TOP}V${floor}`).join("") + ticks.values.map((y) => `M${left} ${py(y).toFixed(1)}H${left + this.inner}`).join("");
        let body = `<path d="${grid}" stroke="currentColor" stroke-opacity=".14" fill="none"/><path d="M${left} ${TOP}V${floor}H${left + this.inner}" stroke="currentColor" stroke-opacity=".7" fill="none"/>`;
        body += ticks.values.map((y, i) => `<text x="${left - 6}" y="${(py(y) + 4).toFixed(1)}" text-anchor="end">${ticks.labels[i]}</text>`).join("");
        if (last) body += `<text x="${left + this.inner}" y="${floor + 30}" text-anchor="end" fill-opacity=".65">${safe(this.label)}${across.scale ? ` (${across.scale})` : ""}</text>`;
        if (last) body += across.values.map((x, i) => `<text x="${px(x).toFixed(1)}" y="${floor + 15}" text-anchor="middle">${across.labels[i]}</text>`).join("");
        const clip = `clip-${this.number}-${k}`;
        body += `<clipPath id="${clip}"><rect x="${left}" y="${TOP - 3}" width="${this.inner}" height="${height + 6}"/></clipPath><g clip-path="url(#${clip})">`;
        for (const line of panel.lines) body += this.line(line, [from, to], px, py);
        if (!panel.lines.some((line) => line.y.some(Number.isFinite))) {
          body += `<text x="${left + this.inner / 2}" y="${TOP + height / 2}" text-anchor="middle" fill-opacity=".65">${safe(panel.empty)}</text>`;
        }
        const whole = last ? floor + BOTTOM : floor + 6;
        one.picture.innerHTML = `<svg viewBox="0 0 ${width} ${whole}" width="100%" font-size="11.5" fill="currentColor" role="img" aria-label="${safe(panel.title || panel.label)}">${body}</g></svg>`;
        one.axes.style.setProperty("--floor", `${floor}px`);
        one.cursor.style.top = one.chosen.style.top = `${TOP}px`;
        one.cursor.style.height = one.chosen.style.height = `${height}px`;
        const unit = one.head.querySelector(".unit");
        unit.textContent = [panel.label, ticks.scale].filter(Boolean).join(" ");
        one.span = high - low;
      });
      this.point();
    }

    /** The ends of a vertical axis over what is seen, and its numbers. */
    scale(panel, range, height) {
      let low = Infinity, high = -Infinity;
      for (const line of panel.lines) {
        const [first, last] = seen(line, range);
        for (let k = first; k <= last; k++) {
          const y = line.base + line.y[k];
          if (!Number.isFinite(y) || (panel.log && y <= 0)) continue;
          low = Math.min(low, y);
          high = Math.max(high, y);
        }
      }
      const most = Math.max(2, Math.floor(height / 30));
      if (!(low <= high)) [low, high] = panel.log ? [0.1, 1] : [0, 1];
      if (panel.log) {
        const air = high > 2 * low ? (high / low) ** 0.05 : 1.6;
        low /= air;
        high *= air;
        return { low, high, ticks: logarithmic(low, high, most) };
      }
      const size = Math.max(Math.abs(low), Math.abs(high));
      const least = Math.max(panel.least, 1e-7 * size);
      let more = Math.max(0, (least - (high - low)) / 2);
      if (high - low + 2 * more === 0) more = 0.5;
      low -= more;
      high += more;
      const air = 0.05 * (high - low);
      return { low: low - air, high: high + air, ticks: linear(low - air, high + air, most) };
    }

    line(line, range, px, py) {
      const [first, last] = seen(line, range);
      const color = safe(line.color || "currentColor");
      let body = "";
      if (line.drawn && last > first) {
        const { path, band } = last - first > this.inner ? reduced(line, first, last, px, py, this.left, this.inner) : polyline(line, first, last, px, py);
        if (band) body += `<path class="band" d="${band}" fill="${color}" fill-opacity=".25" stroke="${color}" stroke-opacity=".55" stroke-width=".7"/>`;
        const dash = line.dash ? ` stroke-dasharray="${safe(line.dash)}"` : "";
        body += `<path class="line" d="${path}" fill="none" stroke="${color}" stroke-width="1.5" stroke-linejoin="round"${dash}/>`;
      }
      if (line.marker) {
        const kind = line.marker === "cross" ? `fill="none" stroke="${color}" stroke-width="1.3"` : `fill="${color}"`;
        const places = new Set();
        for (let k = first; k <= last && places.size < 3000; k++) {
          const y = py(line.base + line.y[k]);
          if (Number.isFinite(y)) places.add(`${Math.round(px(line.x[k]))} ${Math.round(y)}`);
        }
        const sign = SIGNS[line.marker] || SIGNS.circle;
        body += `<g ${kind}>${[...places].map((at) => `<path transform="translate(${at})" d="${sign}"/>`).join("")}</g>`;
      }
      return body;
    }

    // --- cursor and zoom

    listen(one) {
      const { axes, chosen } = one;
      let start = null;
      const at = (event) => {
        const x = event.clientX - axes.getBoundingClientRect().left;
        return Math.min(this.left + this.inner, Math.max(this.left, x));
      };
      const value = (x) => {
        const [from, to] = this.range();
        return from + ((x - this.left) / this.inner) * (to - from);
      };
      axes.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        point(this, value(at(event)));
        if (event.pointerType === "touch" || !this.timed) return;
        axes.setPointerCapture(event.pointerId);
        start = at(event);
      });
      axes.addEventListener("pointermove", (event) => {
        const x = at(event);
        point(this, value(x));
        if (start === null) return;
        chosen.style.display = Math.abs(x - start) > 4 ? "block" : "none";
        chosen.style.left = `${Math.min(x, start)}px`;
        chosen.style.width = `${Math.abs(x - start)}px`;
      });
      axes.addEventListener("pointerup", (event) => {
        chosen.style.display = "none";
        if (start === null) return;
        const [a, b] = [value(start), value(at(event))].sort((p, q) => p - q);
        if (Math.abs(at(event) - start) > 6) zoom([a, b]);
        start = null;
      });
      axes.addEventListener("pointercancel", () => {
        chosen.style.display = "none";
        start = null;
      });
      axes.addEventListener("pointerleave", () => start === null && this.timed && frame === null && point(this, null));
      axes.addEventListener("dblclick", () => this.timed && zoom(whole));
    }

    key(event) {
      const [from, to] = this.range();
      const step = ((to - from) / this.inner) * (event.shiftKey ? 20 : 2);
      const now = cursor === null ? (from + to) / 2 : cursor;
      if (event.key === "ArrowLeft") point(this, Math.max(from, now - step));
      else if (event.key === "ArrowRight") point(this, Math.min(to, now + step));
      else if (event.key === "+") scaled(0.5);
      else if (event.key === "-") scaled(2);
      else if (event.key === "0" || event.key === "Escape") zoom(whole);
      else return;
      event.preventDefault();
    }

    /** Put the cursor where it is, and its values into the keys. */
    point() {
      const [from, to] = this.range();
      const here = this.timed ? cursor : this.own;
      const shown = here !== null && here !== undefined && here >= from && here <= to;
      for (const one of this.axes) {
        one.cursor.style.display = shown ? "block" : "none";
        if (shown) one.cursor.style.left = `${this.left + ((here - from) / (to - from || 1)) * this.inner}px`;
        one.panel.lines.forEach((line, k) => {
          const value = valueAt(line, here);
          // Along a logarithm small values are told beside large ones.
          one.outputs[k].textContent = shown && line.drawn ? told(value, one.panel.log ? Math.abs(value) : one.span) : "";
        });
      }
    }
  }

  function point(figure, x) {
    if (!figure.timed) {
      figure.own = x;
      figure.point();
      return;
    }
    cursor = x;
    for (const one of figures) if (one.timed) one.point();
    write();
    if (x !== null && frame) frame.contentWindow.holonom?.seek(x);
  }

  function zoom(range) {
    const least = 1e-6 * (whole[1] - whole[0]);
    view = [Math.max(whole[0], range[0]), Math.min(whole[1], range[1])];
    if (!(view[1] - view[0] > least)) view = whole;
    figures.forEach((one) => one.timed && one.draw());
    write();
  }

  function scaled(factor) {
    if (!factor) return zoom(whole);
    const middle = cursor !== null && cursor > view[0] && cursor < view[1] ? cursor : (view[0] + view[1]) / 2;
    zoom([middle - (middle - view[0]) * factor, middle + (view[1] - middle) * factor]);
  }

  function moved(part) {
    const length = view[1] - view[0];
    const from = Math.min(Math.max(whole[0], view[0] + part * length), whole[1] - length);
    zoom([from, from + length]);
  }

  function write() {
    const range = document.getElementById("range");
    if (!range || !view) return;
    const span = view[1] - view[0];
    const [from, to] = view.map((time) => String(Number(moment(time, span))));
    range.textContent = signed(cursor === null ? `${from} to ${to} s` : `${moment(cursor, span / 10)} s`);
  }

  // --- beginning

  async function drawFigures() {
    const buffer = await unpacked("figures");
    if (!buffer) return;
    const length = new DataView(buffer).getUint32(0, true);
    const data = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    const first = 4 + length;
    for (const figure of data) {
      for (const line of figure.panels.flatMap((panel) => panel.lines)) {
        line.x = new Float64Array(buffer, first + line.x, line.count);
        line.y = new Float32Array(buffer, first + line.y, line.count);
      }
    }
    for (const root of document.querySelectorAll("figure[data-figure]")) {
      const number = Number(root.dataset.figure);
      figures.push(new Figure(root, data[number], number));
    }
    const timed = figures.filter((one) => one.timed && one.root.closest("section"));
    const spans = (timed.length ? timed : figures).map((one) => one.span);
    whole = view = spans.length ? [Math.min(...spans.map((s) => s[0])), Math.max(...spans.map((s) => s[1]))] : [0, 1];
    const tools = document.getElementById("tools");
    if (tools) {
      tools.hidden = false;
      for (const button of tools.querySelectorAll("button")) {
        button.addEventListener("click", () => (button.dataset.zoom === undefined ? moved(Number(button.dataset.move)) : scaled(Number(button.dataset.zoom))));
      }
      write();
    }
    let width = 0;
    new ResizeObserver(([entry]) => {
      if (Math.round(entry.contentRect.width) === width) return;
      width = Math.round(entry.contentRect.width);
      figures.forEach((one) => one.draw());
      document.documentElement.dataset.ready = "true";
    }).observe(document.querySelector("main"));
    for (const details of document.querySelectorAll("details")) {
      details.addEventListener("toggle", () => figures.forEach((one) => details.contains(one.root) && one.draw()));
    }
  }

  function offerMotion() {
    const button = document.getElementById("play");
    if (!button || !window.DecompressionStream) return;
    button.hidden = false;
    button.addEventListener("click", async () => {
      button.textContent = "…";
      const page = new TextDecoder().decode(await unpacked("scene"));
      frame = document.createElement("iframe");
      frame.title = document.title;
      frame.allowFullscreen = true;
      frame.srcdoc = page;
      frame.addEventListener("load", () => {
        frame.contentWindow.holonom?.play(true);
        requestAnimationFrame(keepStep);
      });
      document.getElementById("poster").style.display = "none";
      button.replaceWith(frame);
    });
  }

  /** The cursor goes with the motion while that plays. */
  function keepStep(now) {
    requestAnimationFrame(keepStep);
    const motion = frame.contentWindow?.holonom;
    if (!motion?.playing || now - stepped < 80) return;
    stepped = now;
    cursor = motion.time;
    for (const one of figures) if (one.timed && one.root.offsetParent) one.point();
    write();
  }

  // On paper nothing is folded.
  let opened = [];
  window.addEventListener("beforeprint", () => {
    opened = [...document.querySelectorAll("details:not([open]):not(.text)")];
    for (const details of opened) details.open = true;
    figures.forEach((one) => one.draw());
  });
  window.addEventListener("afterprint", () => opened.forEach((details) => (details.open = false)));

  offerMotion();
  drawFigures();
})();
