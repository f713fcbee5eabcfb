// What Python puts into the page (holonom/view/scene.py), decoded. SI units, ground axes.

import { DataUtils } from "three";

export type Triple = [number, number, number];

interface Blob {
  kind: "f2" | "f4" | "i2" | "u2" | "u4";
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

/** Where a body goes: what is known of it at some times, between which `poseAt` says the rest. */
export interface Way {
  /** From the start of the run on, s. */
  times: Float32Array;
  /** From `origin` on, m; m/s. */
  position: Float32Array;
  velocity: Float32Array;
  /** Euler parameters; angular velocity, rad/s. */
  rotation: Int16Array;
  spin: Float32Array;
}

type WayBlobs = Record<keyof Way, Blob>;

export interface Body extends Way {
  name: string;
  title: string;
  center: Triple;
  kind: number;
  shapes: Shape[];
  origin: Triple;
  /** The stretch of its way where it was last. */
  at: number;
}

export interface Channel {
  name: string;
  item: string;
  quantity: string;
  unit: string;
  frame: string;
  asked: boolean;
  components: string[];
  /** Of each component. */
  units: string[];
  low: number[];
  high: number[];
  /** One curve per component. */
  curves: Float32Array[];
  /** What they reach from each frame to the next, where the line between these does not tell. */
  lowest?: Float32Array[];
  highest?: Float32Array[];
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
  /** Of the frames, which channels have and keys step through, from the start on. */
  times: Float32Array;
  /** How far bodies are drawn from where the run has them: m, rad. */
  missed?: [number, number];
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

function halves(blob: Blob): Float32Array {
  return Float32Array.from(new Uint16Array(bytes(blob)), DataUtils.fromHalfFloat);
}

function way(raw: WayBlobs): Way {
  return {
    times: new Float32Array(bytes(raw.times)),
    position: new Float32Array(bytes(raw.position)),
    velocity: halves(raw.velocity),
    rotation: new Int16Array(bytes(raw.rotation)),
    spin: halves(raw.spin),
  };
}

function curves(blob: Blob, lows: number[], highs: number[]): Float32Array[] {
  const width = lows.length;
  if (blob.kind === "f4") return columns(new Float32Array(bytes(blob)), width);
  const codes = new Uint16Array(bytes(blob));
  return lows.map((low, column) => {
    const step = (highs[column] - low) / (MISSING - 1);
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
  bodies: WayBlobs[];
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
    const [body, next] = [run.bodies[k], way(more)];
    body.times = grown(body.times, next.times);
    body.position = grown(body.position, next.position);
    body.velocity = grown(body.velocity, next.velocity);
    body.rotation = grown(body.rotation, next.rotation);
    body.spin = grown(body.spin, next.spin);
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
      ...way(body),
      at: 0,
    })),
    channels: raw.channels.map((channel: any) => ({
      ...channel,
      curves: curves(channel, channel.low, channel.high),
      lowest: channel.lowest && curves(channel.lowest, channel.low, channel.high),
      highest: channel.highest && curves(channel.highest, channel.low, channel.high),
    })),
  };
}
