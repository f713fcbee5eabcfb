// Joints, forces and drivers as symbols. What stretches between two bodies is moved at every frame.

import {
  BoxGeometry, BufferGeometry, Color, Group, Object3D, Quaternion, Vector3,
} from "three";
import type { Batches, Layer } from "./batch";
import type { Element, Frame, Run } from "./data";
import {
  alongZ, axisOf, ball, coil, cylinder, merge, paint, ring, rod, roundArrow, spiral, standing, turnOf, tyre, vector,
} from "./geometry";
import { poseAt } from "./motion";
import { BEARING, DAMPER, DRIVER, FORCE, JOINT, JOINT_LIGHT, RUBBER, SPRING, STEEL, TYRE } from "./theme";

/** Moves what stretches or turns by itself. */
export type Move = () => void;

export interface Stage {
  run: Run;
  /** Group of a body, or of the ground. */
  holder(body: number | null): Object3D;
  /** Where a frame is, ground axes. */
  place(frame: Frame, target: Vector3): Vector3;
  up: Vector3;
  batches: Batches;
}

type Add = (geometry: BufferGeometry, holder: Object3D, color?: number) => Object3D;

const ORIGIN = new Vector3();
const Z = new Vector3(0, 0, 1);

/** Draws an element; what moves by itself comes back. */
export function symbolOf(stage: Stage, element: Element): Move | null {
  const planar = stage.run.dimension === "planar";
  const [first, second = first] = element.frames;
  const s = element.size;
  const layer: Layer = { kind: element.collection === "forces" ? "force" : "joint" };
  const painted = (geometry: BufferGeometry, color?: number) =>
    color === undefined ? geometry : paint(geometry, new Color(color));
  /** What moves by itself. */
  const add: Add = (geometry, holder, color) => {
    const actor = new Object3D();
    holder.add(actor);
    const own: Layer = element.type === "distance" ? { kind: "force" } : layer;
    stage.batches.add(own, element.name, painted(geometry, color), actor);
    return actor;
  };
  /** What is fixed in a body or in the ground. */
  const fix = (geometry: BufferGeometry, body: number | null, color?: number, own: Layer = layer) =>
    stage.batches.add(own, element.name, painted(geometry, color), stage.holder(body));
  const dark = new Color(JOINT);
  const light = new Color(JOINT_LIGHT);
  const at = vector(first.point);
  const axis = axisOf(first, planar && element.type === "translational" ? 0 : 2);
  /** A symbol that sits where the frame of the first body is. */
  const onFirst = (parts: BufferGeometry[], turn = turnOf(first)) =>
    fix(merge(parts).applyQuaternion(turn).translate(at.x, at.y, at.z), first.body);
  const onGround = () => {
    const frame = element.frames.find((one) => one.body === null);
    if (!frame || element.frames.length < 2) return;
    const stand = standing(s, planar);
    if (!planar) stand.applyQuaternion(new Quaternion().setFromUnitVectors(Z, stage.up));
    else stand.translate(0, 0, -1.5 * s);
    stand.translate(frame.point[0], frame.point[1], frame.point[2]);
    fix(stand, null, BEARING);
  };
  const along = (half: number) => [new Vector3(0, 0, -half), new Vector3(0, 0, half)] as const;

  let move: Move | null = null;
  switch (element.type) {
    case "revolute":
      onFirst(
        [paint(cylinder(...along(1.9 * s), s), dark), paint(cylinder(...along(2.05 * s), 0.55 * s), light)],
        planar ? new Quaternion() : undefined,
      );
      onGround();
      break;
    case "spherical":
      onFirst([paint(ball(ORIGIN, 1.25 * s), dark), paint(ring(1.2 * s, 0.22 * s), light)]);
      onGround();
      break;
    case "universal": {
      const pin = (frame: Frame) => {
        const [a, b] = along(2.2 * s);
        const geometry = paint(cylinder(a, b, 0.6 * s), dark).applyQuaternion(turnOf(frame));
        fix(geometry.translate(...frame.point), frame.body);
      };
      pin(first);
      pin(second);
      onGround();
      break;
    }
    case "fixed":
      onFirst([paint(new BoxGeometry(2 * s, 2 * s, 2 * s), dark)]);
      onGround();
      break;
    case "translational":
    case "cylindrical": {
      const [low, high] = travel(stage, first, second, axis);
      const r = (element.type === "cylindrical" ? 0.7 : 0.42) * s;
      const [a, b] = [low - 4 * s, high + 4 * s].map((way) => at.clone().addScaledVector(axis, way));
      const parts = [paint(cylinder(a, b, r), dark)];
      for (const [end, way] of [[a, 1], [b, -1]] as const) {
        parts.push(paint(cylinder(end, end.clone().addScaledVector(axis, 0.6 * s * way), 2.2 * r), dark));
      }
      fix(merge(parts), first.body);
      break;
    }
    case "distance": {
      const mesh = add(cylinder(ORIGIN, Z, 1), holderless(stage), STEEL);
      for (const frame of [first, second]) {
        fix(ball(vector(frame.point), 0.95 * s), frame.body, JOINT);
      }
      move = between(stage, first, second, mesh, 0.5 * s, true);
      break;
    }
    case "tsda":
    case "maxwell":
      move = spring(stage, element, add);
      break;
    case "rsda": {
      const joint = jointBetween(stage.run, element);
      const frame = joint?.frames[0] ?? { ...first, point: middleOf(stage.run, first.body) };
      const turn = planar ? new Quaternion() : turnOf(first);
      const geometry = paint(spiral(2.1 * s), new Color(SPRING)).applyQuaternion(turn).translate(...frame.point);
      if (planar) geometry.translate(0, 0, 2 * s);
      fix(geometry, frame.body);
      break;
    }
    case "bushing":
      onFirst([
        paint(ring(1.6 * s, 0.62 * s), new Color(RUBBER)),
        paint(cylinder(...along(1.1 * s), 0.9 * s), dark),
      ]);
      break;
    case "tyre": {
      const [way, radius] = [vector(element.axis!).normalize(), element.radius!];
      fix(tyre(at, way, radius), first.body, TYRE);
      const [left, right] = [-0.22, 0.22].map((part) => at.clone().addScaledVector(way, part * radius));
      stage.batches.addShadow(cylinder(left, right, radius), stage.holder(first.body));
      break;
    }
    case "torque":
    case "rotation": {
      const joint = element.type === "rotation" ? null : jointBetween(stage.run, element);
      const frame = joint?.frames[1] ?? second;
      const turn = planar ? new Quaternion() : turnOf(joint ? frame : second);
      const color = element.collection === "drivers" ? DRIVER : FORCE;
      const arrow = merge(roundArrow(4 * s).map((part) => paint(part, new Color(color))));
      const place = joint || element.type === "rotation" ? frame.point : middleOf(stage.run, frame.body);
      const geometry = arrow.applyQuaternion(turn).translate(...place);
      // It turns with the bodies' place, not with the body: the arrow says about what, not how far.
      const mesh = add(geometry.translate(...(place.map((x) => -x) as [number, number, number])), holderless(stage));
      if (planar) geometry.translate(0, 0, 2 * s);
      const point = { ...frame, point: place };
      move = () => void stage.place(point, mesh.position);
      break;
    }
    case "translation":
    case "point_force":
      fix(ball(at, 0.8 * s), first.body, element.collection === "drivers" ? DRIVER : FORCE);
      break;
    default:
      return null;
  }
  return move;
}

function middleOf(run: Run, body: number | null): [number, number, number] {
  return body === null ? [0, 0, 0] : run.bodies[body].center;
}

function jointBetween(run: Run, element: Element): Element | undefined {
  const wanted = element.frames.map((frame) => frame.body);
  return run.elements.find(
    (one) =>
      one.collection === "joints" &&
      one.frames.every((frame) => wanted.includes(frame.body)) &&
      one.frames.some((frame) => frame.body === wanted[wanted.length - 1]) &&
      ["revolute", "cylindrical", "universal", "spherical"].includes(one.type),
  );
}

/** Group for symbols that belong to no body. */
function holderless(stage: Stage): Object3D {
  return stage.holder(null);
}

const a = new Vector3();
const b = new Vector3();
const line = new Vector3();

function between(stage: Stage, first: Frame, second: Frame, mesh: Object3D, radius: number, thick: boolean) {
  return () => {
    stage.place(first, a);
    stage.place(second, b);
    line.copy(b).sub(a);
    const length = Math.max(1e-9 * stage.run.size, line.length());
    mesh.position.copy(a);
    alongZ(line.multiplyScalar(1 / length), mesh.quaternion);
    mesh.scale.set(thick ? radius : 1, thick ? radius : 1, length);
  };
}

function spring(stage: Stage, element: Element, add: Add): Move {
  const [first, second] = element.frames;
  const s = element.size;
  const least = 1e-9 * stage.run.size;
  const length = Math.max(least, stage.place(first, a).distanceTo(stage.place(second, b)));
  const coiled = element.type === "maxwell" || element.elastic;
  const damped = element.type === "maxwell" || element.damped || !element.elastic;
  const radius = Math.min(0.2 * length, 1.7 * s);
  const pair = new Group();
  stage.holder(null).add(pair);
  const series = element.type === "maxwell";
  if (coiled) {
    const turns = Math.round(Math.min(12, Math.max(5, length / (1.1 * radius))));
    const geometry = coil(radius, 0.15 * radius, length, turns);
    const mesh = add(paint(geometry, new Color(SPRING)), pair);
    if (series) mesh.scale.z = 0.5;
  }
  let tube: Object3D | undefined;
  let piston: Object3D | undefined;
  const start = series ? 0.5 : 0;
  if (damped) {
    const r = coiled && !series ? 0.48 * radius : 0.62 * radius;
    // Tube and piston keep their lengths while the damper gets longer and shorter.
    tube = add(paint(cylinder(ORIGIN, new Vector3(0, 0, 0.58 * (1 - start)), r), new Color(DAMPER)), pair);
    piston = add(rod(new Vector3(0, 0, -0.6 * (1 - start)), ORIGIN, 0.42 * r), pair, STEEL);
  }
  return () => {
    stage.place(first, a);
    stage.place(second, b);
    line.copy(b).sub(a);
    const now = Math.max(least, line.length());
    pair.position.copy(a);
    alongZ(line.multiplyScalar(1 / now), pair.quaternion);
    pair.scale.set(1, 1, now);
    if (tube && piston) {
      tube.position.z = start;
      tube.scale.z = piston.scale.z = length / now;
      piston.position.z = 1;
    }
  };
}

/** How far the second body slides along an axis of the first over the run, from the frame's point. */
function travel(stage: Stage, first: Frame, second: Frame, axis: Vector3): [number, number] {
  const { run } = stage;
  const count = 200;
  const [p, q] = [new Vector3(), new Vector3()];
  const [turn, other] = [new Quaternion(), new Quaternion()];
  let [low, high] = [Infinity, -Infinity];
  const point = vector(second.body === null ? second.point : run.bodies[second.body].center);
  for (let k = 0; k < count; k++) {
    const time = (k / (count - 1)) * run.times[run.times.length - 1];
    if (second.body === null) q.copy(point);
    else {
      poseAt(run.bodies[second.body], time, q, other);
      q.add(point.clone().applyQuaternion(other));
    }
    if (first.body !== null) {
      poseAt(run.bodies[first.body], time, p, turn);
      q.sub(p).applyQuaternion(turn.invert());
    }
    const way = q.sub(vector(first.point)).dot(axis);
    low = Math.min(low, way);
    high = Math.max(high, way);
  }
  return [low, high];
}
