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

/* eslint-disable @typescript-eslint/no-explicit-any -- JSON */
function shape(raw: any): Shape {
  if (raw.type !== "mesh") return raw;
  return { ...raw, vertices: new Float32Array(bytes(raw.vertices)), faces: new Uint32Array(bytes(raw.faces)) };
}

export function readRuns(): Run[] {
  const text = document.getElementById("holonom-data")?.textContent ?? "null";
  const data = JSON.parse(text);
  return (data?.runs ?? []).map((raw: any) => ({
    ...raw,
    times: new Float32Array(bytes(raw.times)),
    bodies: raw.bodies.map((body: any) => ({
      ...body,
      shapes: body.shapes.map(shape),
      position: new Float32Array(bytes(body.position)),
      rotation: new Int16Array(bytes(body.rotation)),
    })),
    channels: raw.channels.map((channel: any) => ({ ...channel, curves: curves(channel) })),
  }));
}
