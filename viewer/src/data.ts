// What Python puts into the page (holonom/view/scene.py), decoded. SI units, ground axes.

export type Triple = [number, number, number];

interface Blob {
  kind: "f4" | "i2" | "u2" | "u4";
  data: string;
}

/** How a shape that the model states is placed, and how it looks. */
interface Placed {
  at: Triple;
  /** Rows of the matrix whose columns are its own axes. */
  axes?: Triple[];
  color?: Triple | null;
  opacity?: number;
}

export type Shape =
  | { type: "rod"; from: Triple; to: Triple; radius: number }
  | { type: "plate"; points: Triple[]; thickness: number }
  | { type: "hull"; points: Triple[]; radius: number }
  | ({ type: "box"; size: Triple } & Placed)
  | ({ type: "sphere"; radius: number } & Placed)
  | ({ type: "cylinder" | "capsule"; radius: number; length: number } & Placed)
  | ({ type: "mesh"; vertices: Float32Array; faces: Uint32Array } & Placed)
  | { type: "wheel"; at: Triple; axis: Triple; radius: number; width: number };

export interface Frame {
  body: number | null;
  point: Triple;
  /** Rows of the matrix whose columns are the axes f, g, h. */
  axes: Triple[];
}

export interface Element {
  collection: "joints" | "forces" | "drivers";
  name: string;
  title: string;
  type: string;
  frames: Frame[];
  size: number;
  elastic?: boolean;
  damped?: boolean;
  radius?: number;
  axis?: Triple | null;
}

export interface Body {
  name: string;
  title: string;
  center: Triple;
  kind: number;
  thickness: number;
  shapes: Shape[];
  origin: Triple;
  position: Float32Array;
  rotation: Int16Array;
}

export interface Channel {
  name: string;
  item: string;
  quantity: string;
  unit: string;
  frame: string;
  asked: boolean;
  components: string[];
  low: number[];
  high: number[];
  /** One curve per component. */
  curves: Float32Array[];
}

export interface Road {
  x: number[];
  height: number[];
  y: [number, number];
}

export interface Run {
  title: string;
  name: string;
  file: string;
  status: string;
  completed: boolean;
  method: string;
  dimension: "planar" | "spatial";
  gravity: Triple;
  size: number;
  start: number;
  times: Float32Array;
  follow: number | null;
  /** Of a run that goes on: how often its rows were thinned out. */
  generation?: number;
  bodies: Body[];
  elements: Element[];
  roads: Road[];
  channels: Channel[];
}

const MISSING = 65535;

function bytes(blob: Blob): ArrayBuffer {
  const text = atob(blob.data);
  const out = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) out[i] = text.charCodeAt(i);
  return out.buffer;
}

function curves(raw: Channel & Blob): Float32Array[] {
  if (raw.kind === "f4") return columns(new Float32Array(bytes(raw)), raw.low.length);
  const codes = new Uint16Array(bytes(raw));
  const width = raw.low.length;
  return raw.low.map((low, column) => {
    const step = (raw.high[column] - low) / (MISSING - 1);
    const out = new Float32Array(codes.length / width);
    for (let i = 0; i < out.length; i++) {
      const code = codes[i * width + column];
      out[i] = code === MISSING ? NaN : low + code * step;
    }
    return out;
  });
}

function columns(values: Float32Array, width: number): Float32Array[] {
  return Array.from({ length: width }, (_, column) => {
    const out = new Float32Array(values.length / width);
    for (let i = 0; i < out.length; i++) out[i] = values[i * width + column];
    return out;
  });
}

/** Rows of a run that goes on. */
export interface Rows {
  generation: number;
  /** Whether these are all rows there are. */
  whole: boolean;
  status: string;
  times: Blob;
  bodies: { position: Blob; rotation: Blob }[];
  channels: (Blob & { low: number[]; high: number[] })[];
  roads: Road[];
}

/** Adds rows to a run, and returns how many. */
export function extend(run: Run, rows: Rows): number {
  const grown = <T extends Float32Array | Int16Array>(old: T, more: T): T => {
    if (rows.whole) return more;
    const out = new (old.constructor as new (length: number) => T)(old.length + more.length);
    out.set(old);
    out.set(more, old.length);
    return out;
  };
  const times = new Float32Array(bytes(rows.times));
  if (!times.length) return 0;
  run.times = grown(run.times, times);
  rows.bodies.forEach((more, k) => {
    const body = run.bodies[k];
    body.position = grown(body.position, new Float32Array(bytes(more.position)));
    body.rotation = grown(body.rotation, new Int16Array(bytes(more.rotation)));
  });
  rows.channels.forEach((more, k) => {
    const channel = run.channels[k];
    Object.assign(channel, { low: more.low, high: more.high });
    const curves = columns(new Float32Array(bytes(more)), more.low.length);
    channel.curves = channel.curves.map((curve, n) => grown(curve, curves[n]));
  });
  run.roads = rows.roads;
  return times.length;
}

/* eslint-disable @typescript-eslint/no-explicit-any -- JSON */
function shape(raw: any): Shape {
  if (raw.type !== "mesh") return raw;
  return { ...raw, vertices: new Float32Array(bytes(raw.vertices)), faces: new Uint32Array(bytes(raw.faces)) };
}

/** What to draw for a picture or a film, whose frames are sent back. */
export interface Job {
  times: number[];
  size: [number, number];
  camera: "iso" | "front" | "side" | "top";
  dark: boolean;
}

export interface Data {
  runs: Run[];
  job: Job | null;
  /** Whether the run goes on, and its rows are asked for. */
  live: boolean;
}

export function readData(): Data {
  const text = document.getElementById("holonom-data")?.textContent ?? "null";
  const data = JSON.parse(text);
  return { runs: (data?.runs ?? []).map(readRun), job: data?.job ?? null, live: data?.live === true };
}

export function readRun(raw: any): Run {
  return {
    ...raw,
    times: new Float32Array(bytes(raw.times)),
    bodies: raw.bodies.map((body: any) => ({
      ...body,
      shapes: body.shapes.map(shape),
      position: new Float32Array(bytes(body.position)),
      rotation: new Int16Array(bytes(body.rotation)),
    })),
    channels: raw.channels.map((channel: any) => ({ ...channel, curves: curves(channel) })),
  };
}
