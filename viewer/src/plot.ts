// Curves of one channel over time, with a cursor that keeps step with the motion.

import type { Channel, Run } from "./data";
import { covers, placeAt, valueAt } from "./motion";
import { CURVES, GHOSTS_CSS, theme } from "./theme";

export interface Line {
  run: Run;
  number: number;
  channel: Channel;
}

const LEFT = 58;
const RIGHT = 8;
const TOP = 6;
const BOTTOM = 18;
/** Curves whose range is a smaller part of that of common axes get axes of their own. */
const SMALLER = 0.1;

const html = (tag: string, name = "", text = "") => {
  const element = document.createElement(tag);
  if (name) element.className = name;
  if (text) element.textContent = text;
  return element;
};

export const unitText = (unit: string) => unit.replace(/\^2/g, "²").replace(/\^3/g, "³");

/** A number to the digits that a plot can tell. */
export function short(value: number, span = Math.abs(value)): string {
  if (!Number.isFinite(value)) return "–";
  if (value === 0 || Math.abs(value) < 1e-9 * span) return "0";
  const size = Math.abs(value);
  if (size >= 1e5 || size < 1e-3) return value.toExponential(2).replace("e+", "e").replace("-", "−").replace("e-", "e−");
  const digits = Math.max(0, Math.min(5, 3 - Math.floor(Math.log10(size))));
  return value.toFixed(digits).replace("-", "−");
}

/** Round steps of an axis. */
function ticks(low: number, high: number, most: number): [number, string][] {
  const raw = (high - low) / most;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = power * ([1, 2, 5, 10].find((k) => k * power >= raw) ?? 10);
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const size = Math.max(Math.abs(low), Math.abs(high));
  const plain = size < 1e6 && digits <= 5;
  const out: [number, string][] = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) {
    const value = k * step;
    const text = plain ? value.toFixed(digits) : value.toExponential(Math.max(0, Math.floor(Math.log10(size)) + digits));
    out.push([value, k === 0 ? "0" : text.replace("e+", "e").replace(/-/g, "−")]);
  }
  return out;
}

/** Two pixels of a plot: what a curve does in them. */
interface Column {
  x: number;
  low: number;
  high: number;
  first: number;
  last: number;
  sum: number;
  count: number;
  turns: number;
  /** Whether it reaches between its frames what these do not tell. */
  between: boolean;
  dense: boolean;
}

/** Pixels of a column; so many turns in it, or more, and the curve would be a bar of ink. */
const COLUMN = 2;
const TURNS = 2;
/** Columns on either side over which the mean is taken. */
const AROUND = 3;

/** What a curve reaches between its frames, where the lines between these do not tell. */
interface Range {
  lowest: Float32Array;
  highest: Float32Array;
}

/** Return a curve by columns where it turns back more often than can be drawn or frames can tell, else nothing. */
export function columnsOf(
  run: Run, curve: Float32Array, range: Range | null, place: (time: number) => number, width: number, low: number, high: number,
): Column[] | null {
  const count = Math.floor(width / COLUMN);
  if (curve.length < 3 * TURNS || (curve.length < width / COLUMN && !range)) return null;
  const columns: Column[] = Array.from({ length: count }, (_, k) => ({
    x: LEFT + (k + 0.5) * COLUMN, low: Infinity, high: -Infinity, first: 0, last: 0, sum: 0, count: 0, turns: 0, between: false, dense: false,
  }));
  const least = 1e-3 * (high - low);
  let way = 0;
  for (let i = 0; i < curve.length; i++) {
    const value = curve[i];
    if (Number.isNaN(value)) return null;
    const column = columns[Math.min(count - 1, Math.max(0, Math.floor(place(run.start + run.times[i]) / COLUMN)))];
    const rise = i && Math.abs(value - curve[i - 1]) > least ? Math.sign(value - curve[i - 1]) : 0;
    if (rise) {
      if (way && rise !== way) column.turns++;
      way = rise;
    }
    if (!column.count) column.first = value;
    column.last = value;
    column.low = Math.min(column.low, value);
    column.high = Math.max(column.high, value);
    column.count++;
    if (!range) {
      column.sum += value;
      continue;
    }
    const k = Math.min(i, range.lowest.length - 1);
    const [lowest, highest] = [range.lowest[k], range.highest[k]];
    column.sum += (lowest + highest) / 2;
    column.low = Math.min(column.low, lowest);
    column.high = Math.max(column.high, highest);
    const beyond = Math.max(highest - Math.max(curve[k], curve[k + 1]), Math.min(curve[k], curve[k + 1]) - lowest);
    column.between ||= beyond > Math.max(0.25 * (highest - lowest), 0.01 * (high - low));
  }
  const tall = (c: Column) => c.high - c.low > 0.01 * (high - low);
  const turning = columns.map((c) => c.turns >= TURNS && tall(c));
  // A peak that stands alone between two frames is drawn as a line.
  const thick = columns.map((c, k) => turning[k] || c.between);
  columns.forEach((c, k) => {
    const among = (thick[k - 1] ?? thick[k]) && (thick[k + 1] ?? thick[k]);
    c.dense = turning[k] || (among && c.count > 0);
  });
  return columns.filter((c) => c.dense).length < 4 ? null : columns.filter((c) => c.count);
}

/** Draw ranges where a curve is dense, with the mean in them, and the curve elsewhere. */
function drawColumns(pen: CanvasRenderingContext2D, columns: Column[], y: (value: number) => number): void {
  pen.save();
  pen.globalAlpha = 0.28;
  pen.fillStyle = pen.strokeStyle;
  for (const { x, low, high, dense } of columns) if (dense) pen.fillRect(x - COLUMN / 2, y(high), COLUMN, Math.max(1, y(low) - y(high)));
  pen.restore();
  pen.beginPath();
  columns.forEach((column, k) => {
    const { x, dense, first, low, high, last } = column;
    if (dense) {
      const near = columns.slice(Math.max(0, k - AROUND), k + AROUND + 1);
      pen.lineTo(x, y(near.reduce((sum, c) => sum + c.sum, 0) / near.reduce((sum, c) => sum + c.count, 0)));
    } else for (const value of [first, low, high, last]) pen.lineTo(x, y(value));
  });
  pen.stroke();
}

export class Plot {
  readonly root = html("section", "plot");
  private canvases: { canvas: HTMLCanvasElement; cursor: HTMLElement; components: number[]; height: number }[] = [];
  private values: { cell: HTMLElement; curve: Float32Array; run: Run; span: number }[] = [];

  constructor(private lines: Line[], private span: [number, number], floor: number, seek: (time: number) => void) {
    const { channel } = lines[0];
    const title = html("h3", "", channel.quantity.replace(/_/g, " ").replace(/\./g, " · "));
    const unit = unitText(channel.unit);
    if (unit) title.append(html("span", "unit", unit));
    const frame: Record<string, string> = { first: "axes of the first body", along: "" };
    if (frame[channel.frame]) title.append(html("span", "unit", frame[channel.frame]));
    this.root.append(title);
    const key = html("div", "key");
    for (const { run, number, channel: one } of lines) {
      one.curves.forEach((curve, k) => {
        const cell = html("span", "value");
        const entry = html("span", "entry");
        const dot = html("i", number ? "dash" : "");
        dot.style.background = number && one.curves.length === 1 ? GHOSTS_CSS[(number - 1) % 3] : CURVES[k % CURVES.length];
        entry.append(dot, html("span", "", one.components[k]), cell);
        key.append(entry);
        this.values.push({ cell, curve, run, span: one.high[k] - one.low[k] });
      });
    }
    this.root.append(key);
    for (const components of this.grouped(floor)) {
      const box = html("div", "curves");
      const canvas = document.createElement("canvas");
      const cursor = html("div", "cursor");
      box.append(canvas, cursor);
      this.root.append(box);
      this.canvases.push({ canvas, cursor, components, height: 104 });
      const drag = (event: PointerEvent) => {
        const bounds = canvas.getBoundingClientRect();
        const part = (event.clientX - bounds.left - LEFT) / (bounds.width - LEFT - RIGHT);
        seek(span[0] + Math.min(1, Math.max(0, part)) * (span[1] - span[0]));
      };
      canvas.addEventListener("pointerdown", (event) => {
        canvas.setPointerCapture(event.pointerId);
        drag(event);
      });
      canvas.addEventListener("pointermove", (event) => event.buttons && drag(event));
    }
    this.floor = floor;
  }

  private floor: number;

  /** Components that share axes: those of one unit whose movement is seen on a common scale. */
  private grouped(floor: number): number[][] {
    const { channel } = this.lines[0];
    const lows = channel.components.map((_, k) => Math.min(...this.lines.map(({ channel: one }) => one.low[k])));
    const highs = channel.components.map((_, k) => Math.max(...this.lines.map(({ channel: one }) => one.high[k])));
    const groups: number[][] = [];
    channel.components.forEach((_, k) => {
      const shared = groups.find((group) => {
        const joined = [...group, k];
        const scale = Math.max(...joined.map((i) => highs[i])) - Math.min(...joined.map((i) => lows[i]));
        const seen = (i: number) => highs[i] - lows[i] <= floor || highs[i] - lows[i] >= SMALLER * scale;
        return channel.units[group[0]] === channel.units[k] && joined.every(seen);
      });
      if (shared) shared.push(k);
      else groups.push([k]);
    });
    return groups;
  }

  draw(): void {
    for (const { canvas, components, height } of this.canvases) {
      const width = canvas.parentElement!.clientWidth;
      if (!width) continue;
      const ratio = window.devicePixelRatio || 1;
      canvas.width = width * ratio;
      canvas.height = height * ratio;
      canvas.style.height = `${height}px`;
      const pen = canvas.getContext("2d")!;
      pen.scale(ratio, ratio);
      this.drawOne(pen, components, width, height);
    }
  }

  private drawOne(pen: CanvasRenderingContext2D, components: number[], width: number, height: number): void {
    let low = Infinity;
    let high = -Infinity;
    for (const { channel } of this.lines) {
      for (const k of components) {
        low = Math.min(low, channel.low[k]);
        high = Math.max(high, channel.high[k]);
      }
    }
    const middle = (low + high) / 2;
    const half = Math.max((high - low) / 2, this.floor, 1e-6 * Math.abs(middle), 1e-30) * 1.06;
    [low, high] = [middle - half, middle + half];
    const [t0, t1] = this.span;
    const x = (t: number) => LEFT + ((t - t0) / Math.max(t1 - t0, 1e-30)) * (width - LEFT - RIGHT);
    const y = (v: number) => TOP + ((high - v) / (high - low)) * (height - TOP - BOTTOM);
    const ink = theme.now.dark ? "#a2adb5" : "#5f6a72";
    const faint = theme.now.dark ? "rgba(200,212,220,.13)" : "rgba(60,75,85,.13)";
    pen.font = "10.5px system-ui, sans-serif";
    pen.lineWidth = 1;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const [value, text] of ticks(low, high, 4)) {
      pen.strokeStyle = faint;
      pen.beginPath();
      pen.moveTo(LEFT, Math.round(y(value)) + 0.5);
      pen.lineTo(width - RIGHT, Math.round(y(value)) + 0.5);
      pen.stroke();
      pen.fillStyle = ink;
      pen.fillText(text, LEFT - 6, y(value));
    }
    pen.textBaseline = "top";
    pen.textAlign = "center";
    for (const [time, text] of ticks(t0, t1, Math.max(2, Math.floor(width / 80)))) {
      pen.fillStyle = ink;
      pen.fillText(text, Math.min(x(time), width - 12), height - BOTTOM + 5);
    }
    pen.save();
    pen.beginPath();
    pen.rect(LEFT, TOP - 2, width - LEFT - RIGHT, height - TOP - BOTTOM + 4);
    pen.clip();
    pen.lineJoin = "round";
    for (const { run, number, channel } of this.lines) {
      pen.setLineDash(number ? [5, 3] : []);
      for (const k of components) {
        pen.strokeStyle = number && channel.curves.length === 1 ? GHOSTS_CSS[(number - 1) % 3] : CURVES[k % CURVES.length];
        pen.lineWidth = 1.5;
        const curve = channel.curves[k];
        const { lowest, highest } = channel;
        const range = lowest && highest ? { lowest: lowest[k], highest: highest[k] } : null;
        const dense = columnsOf(run, curve, range, (t) => x(t) - LEFT, width - LEFT - RIGHT, low, high);
        if (dense) {
          drawColumns(pen, dense, y);
          continue;
        }
        pen.beginPath();
        let drawn = false;
        const at = (i: number) => x(run.start + run.times[i]);
        for (let i = 0; i < curve.length; i++) {
          if (Number.isNaN(curve[i])) drawn = false;
          else if (drawn) {
            if (range && range.highest[i - 1] > Math.max(curve[i - 1], curve[i])) pen.lineTo((at(i - 1) + at(i)) / 2, y(range.highest[i - 1]));
            if (range && range.lowest[i - 1] < Math.min(curve[i - 1], curve[i])) pen.lineTo((at(i - 1) + at(i)) / 2, y(range.lowest[i - 1]));
            pen.lineTo(at(i), y(curve[i]));
          } else {
            pen.moveTo(at(i), y(curve[i]));
            drawn = true;
          }
        }
        pen.stroke();
      }
    }
    pen.restore();
  }

  move(time: number): void {
    const [t0, t1] = this.span;
    const part = (time - t0) / Math.max(t1 - t0, 1e-30);
    for (const { canvas, cursor } of this.canvases) {
      cursor.style.transform = `translateX(${LEFT + part * (canvas.clientWidth - LEFT - RIGHT)}px)`;
    }
    for (const { cell, curve, run, span } of this.values) {
      const value = covers(run, time) ? valueAt(curve, placeAt(run, time)) : NaN;
      const text = short(value, Math.max(span, this.floor * 1e3));
      if (cell.textContent !== text) cell.textContent = text;
    }
  }
}
