// Forces as arrows: on the second body by the first, at the joint; of tyres at the road.

import {
  ConeGeometry, CylinderGeometry, InstancedMesh, Matrix4, Object3D, Quaternion, Vector3,
} from "three";
import type { Channel, Element, Frame, Run } from "./data";
import { valueAt, type Place } from "./motion";
import { surface } from "./surface";
import { FORCE } from "./theme";

interface Arrow {
  element: Element;
  frame: Frame;
  force: Channel;
  /** Axis for a force given as one number; ground axes. */
  axis?: Vector3;
  down: number;
}

const Y = new Vector3(0, 1, 0);
const HIDDEN = new Matrix4().makeScale(0, 0, 0);

export class Arrows {
  readonly root = new Object3D();
  private arrows: Arrow[] = [];
  private shafts: InstancedMesh;
  private heads: InstancedMesh;
  private scale = 1;
  private thickness: number;
  shown: "none" | "all" = "none";
  picked: string | null = null;

  constructor(private run: Run, private place: (frame: Frame, target: Vector3) => Vector3) {
    for (const element of run.elements) {
      const isTyre = element.type === "tyre";
      const name = `${element.name}.${isTyre ? "vertical_force" : "force"}`;
      const force = run.channels.find((channel) => channel.name === name);
      if (!force || force.frame === "along" && !isTyre || force.frame === "first") continue;
      const frame = element.frames[element.frames.length - 1];
      const up = new Vector3(0, 0, 1);
      this.arrows.push({
        element, frame, force,
        axis: force.curves.length === 1 ? up : undefined,
        down: isTyre ? element.radius! * 0.98 : 0,
      });
    }
    this.measure();
    this.thickness = 0.0045 * run.size;
    const material = surface({ color: FORCE });
    const count = Math.max(1, this.arrows.length);
    this.shafts = new InstancedMesh(new CylinderGeometry(1, 1, 1, 12).translate(0, 0.5, 0), material, count);
    this.heads = new InstancedMesh(new ConeGeometry(1, 1, 18).translate(0, 0.5, 0), material, count);
    for (const mesh of [this.shafts, this.heads]) {
      mesh.frustumCulled = false;
      this.root.add(mesh);
    }
  }

  /** How long arrows are: by the largest force of the rows there are. */
  measure(): void {
    const own = this.arrows.filter(({ element }) => element.collection !== "drivers");
    const largest = Math.max(0, ...own.map(({ force }) => typical(force)));
    this.scale = largest > 0 ? (0.22 * this.run.size) / largest : 0;
  }

  move(at: Place): void {
    const [p, d, turn, m] = [new Vector3(), new Vector3(), new Quaternion(), new Matrix4()];
    this.root.visible = this.arrows.length > 0 && (this.shown !== "none" || this.picked !== null);
    if (!this.root.visible) return;
    this.arrows.forEach((arrow, k) => {
      const visible = this.shown === "all" || arrow.element.name === this.picked;
      const values = arrow.force.curves.map((curve) => valueAt(curve, at));
      if (arrow.axis) d.copy(arrow.axis).multiplyScalar(values[0]);
      else d.set(values[0], values[1], values[2] ?? 0);
      const length = d.length() * this.scale;
      if (!visible || !(length > 1e-4 * this.run.size)) {
        this.shafts.setMatrixAt(k, HIDDEN);
        this.heads.setMatrixAt(k, HIDDEN);
        return;
      }
      this.place(arrow.frame, p);
      p.z -= arrow.down;
      turn.setFromUnitVectors(Y, d.normalize());
      const head = Math.min(6 * this.thickness, 0.5 * length);
      const width = Math.min(this.thickness, 0.1 * length);
      this.shafts.setMatrixAt(k, m.compose(p, turn, new Vector3(width, length - head, width)));
      p.addScaledVector(d, length - head);
      this.heads.setMatrixAt(k, m.compose(p, turn, new Vector3(2.6 * width, head, 2.6 * width)));
    });
    this.shafts.instanceMatrix.needsUpdate = this.heads.instanceMatrix.needsUpdate = true;
  }
}

/** The force that is exceeded during a tenth of the run: peaks alone do not set the scale. */
function typical(force: Channel): number {
  const count = force.curves[0].length;
  const sizes = new Float32Array(count);
  for (const curve of force.curves) for (let i = 0; i < count; i++) sizes[i] += curve[i] ** 2;
  if (!count) return 0;
  return Math.sqrt(sizes.sort()[Math.floor(0.9 * (count - 1))]) || 0;
}
