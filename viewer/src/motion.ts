// Poses and channels between frames.

import { Quaternion, Vector3 } from "three";
import type { Body, Run } from "./data";

/** A place among the frames: the frame at or before a time, and the part of the way to the next. */
export interface Place {
  frame: number;
  part: number;
}

/** When a run ends, s. */
export const endOf = (run: Run) => run.start + run.times[run.times.length - 1];

/** Whether a run has a state at a time: of runs laid over each other one may end before the others. */
export const covers = (run: Run, time: number) => run.start <= time && time <= endOf(run);

export function placeAt(run: Run, time: number): Place {
  const { times } = run;
  const last = times.length - 1;
  const t = time - run.start;
  if (last <= 0 || t <= times[0]) return { frame: 0, part: 0 };
  if (t >= times[last]) return { frame: last, part: 0 };
  // Frames are even but for results without steps: the guess is nearly always right.
  let frame = Math.min(last - 1, Math.floor((t / times[last]) * last));
  while (frame > 0 && times[frame] > t) frame--;
  while (frame < last - 1 && times[frame + 1] <= t) frame++;
  const span = times[frame + 1] - times[frame];
  return { frame, part: span > 0 ? (t - times[frame]) / span : 0 };
}

/** Returns the stretch of a way with a time in it, from where it was last on. */
function stretchAt(body: Body, t: number): number {
  const { times } = body;
  let low = body.at;
  let high = Math.min(low + 2, times.length - 1);
  if (!(times[low] <= t && t < times[high])) [low, high] = [0, times.length - 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return (body.at = low);
}

const from = new Quaternion();
const to = new Quaternion();
const spin = new Vector3();
const rate = new Quaternion();

/** Reads orientation and `spin` of a knot, and returns the size of the latter, rad/s. */
function readTurn(body: Body, knot: number, turn: Quaternion): number {
  const { rotation: q, spin: w } = body;
  turn.set(q[4 * knot + 1], q[4 * knot + 2], q[4 * knot + 3], q[4 * knot]).normalize();
  return spin.set(w[3 * knot], w[3 * knot + 1], w[3 * knot + 2]).length();
}

/** Adds a multiple of the parameters of one orientation to another's. */
function add(turn: Quaternion, other: Quaternion, part: number): void {
  turn.set(turn.x + part * other.x, turn.y + part * other.y, turn.z + part * other.z, turn.w + part * other.w);
}

/**
 * Writes the pose of a body so many seconds after the start of the run: cubics with the places, orientations and
 * rates at both ends of a stretch, of which the Euler parameters are brought back to length one.
 * The same is in `holonom/view/motion.py`, which chooses the knots by it.
 */
export function poseAt(body: Body, time: number, position: Vector3, turn: Quaternion): void {
  const { times, position: p, velocity: v, origin } = body;
  const i = stretchAt(body, time);
  const j = Math.min(i + 1, times.length - 1);
  const h = times[j] - times[i];
  const s = h > 0 ? Math.min(1, Math.max(0, (time - times[i]) / h)) : 0;
  const r = 1 - s;
  const second = s * s * (3 - 2 * s);
  const [leaving, arriving] = [s * r * r, -s * s * r];
  const along = (k: number) =>
    origin[k] + (1 - second) * p[3 * i + k] + second * p[3 * j + k] + h * (leaving * v[3 * i + k] + arriving * v[3 * j + k]);
  position.set(along(0), along(1), along(2));
  let fastest = readTurn(body, i, from);
  rate.set(spin.x, spin.y, spin.z, 0).multiply(from);
  const first = 0.5 * h * leaving;
  turn.set(first * rate.x, first * rate.y, first * rate.z, first * rate.w);
  fastest = Math.max(fastest, readTurn(body, j, to));
  // Both signs of the parameters mean the same orientation.
  if (from.dot(to) < 0) to.set(-to.x, -to.y, -to.z, -to.w);
  add(turn, rate.set(spin.x, spin.y, spin.z, 0).multiply(to), 0.5 * h * arriving);
  // More than half a turn between two knots is not told by its rates.
  const far = fastest * h >= Math.PI;
  if (far) turn.set(0, 0, 0, 0);
  const chord = far ? leaving + arriving : 0;
  add(turn, from, 1 - second - chord);
  add(turn, to, second + chord);
  turn.normalize();
}

export function valueAt(curve: Float32Array, place: Place): number {
  const a = curve[place.frame];
  return place.part > 0 ? a + (curve[place.frame + 1] - a) * place.part : a;
}
