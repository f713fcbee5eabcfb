// The camera: presets, framing, following; turned by mouse, touch and keys (OrbitControls).

import { Box3, OrthographicCamera, PerspectiveCamera, Quaternion, Vector3, MOUSE, TOUCH } from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

export type Preset = "iso" | "front" | "side" | "top";

/** Where the camera stands, seen with z up: front looks at the nose of what drives along x. */
const FROM: Record<Preset, Vector3> = {
  iso: new Vector3(0.85, -1, 0.42).normalize(),
  front: new Vector3(1, 0, 0.0),
  side: new Vector3(0, -1, 0.0),
  top: new Vector3(0, -0.0001, 1).normalize(),
};

export class Camera {
  readonly camera: PerspectiveCamera | OrthographicCamera;
  readonly controls: OrbitControls;
  private followed = new Vector3();
  private turn = new Quaternion();
  preset: Preset = "iso";

  constructor(canvas: HTMLCanvasElement, planar: boolean, up: Vector3, private size: number) {
    if (planar) {
      this.camera = new OrthographicCamera(-1, 1, 1, -1, 0.01 * size, 100 * size);
    } else {
      this.camera = new PerspectiveCamera(28, 1, 0.004 * size, 400 * size);
      this.camera.up.copy(up);
      this.turn.setFromUnitVectors(new Vector3(0, 0, 1), up);
    }
    this.controls = new OrbitControls(this.camera, canvas);
    Object.assign(this.controls, { enableDamping: false, zoomToCursor: true, minDistance: 0.02 * size, maxDistance: 60 * size });
    if (planar) {
      this.controls.enableRotate = false;
      this.controls.mouseButtons = { LEFT: MOUSE.PAN, MIDDLE: MOUSE.DOLLY, RIGHT: MOUSE.PAN };
      this.controls.touches = { ONE: TOUCH.PAN, TWO: TOUCH.DOLLY_PAN };
    }
  }

  resize(width: number, height: number): void {
    const aspect = width / Math.max(1, height);
    if (this.camera instanceof PerspectiveCamera) this.camera.aspect = aspect;
    else {
      const half = (this.camera.top - this.camera.bottom) / 2;
      Object.assign(this.camera, { left: -half * aspect, right: half * aspect });
    }
    this.camera.updateProjectionMatrix();
  }

  /** Looks from a side at the points, so that all are in the picture. */
  frame(points: Vector3[], preset: Preset = this.preset): void {
    this.preset = preset;
    const { camera, controls } = this;
    if (!points.length) points = [new Vector3(), new Vector3().addScalar(this.size)];
    const box = new Box3().setFromPoints(points);
    const target = box.getCenter(new Vector3());
    if (camera instanceof OrthographicCamera) {
      const extent = box.getSize(new Vector3());
      const aspect = camera.right / camera.top;
      const half = Math.max(0.55 * extent.y, (0.54 * extent.x) / aspect, 0.05 * this.size) * 1.12;
      Object.assign(camera, { top: half, bottom: -half, left: -half * aspect, right: half * aspect, zoom: 1 });
      camera.position.copy(target).add(new Vector3(0, 0, 10 * this.size));
      controls.target.copy(target);
    } else {
      const direction = FROM[preset].clone().applyQuaternion(this.turn);
      const right = new Vector3().crossVectors(camera.up, direction).normalize();
      if (right.lengthSq() < 0.5) right.set(1, 0, 0);
      const above = new Vector3().crossVectors(direction, right);
      const tall = Math.tan((camera.fov * Math.PI) / 360);
      const wide = tall * camera.aspect;
      // Twice: the middle of the picture is not that of the box where things are near.
      let distance = 0;
      for (let pass = 0; pass < 3; pass++) {
        distance = 0;
        let [left, far, low, high] = [Infinity, -Infinity, Infinity, -Infinity];
        for (const point of points) {
          const from = point.clone().sub(target);
          const depth = from.dot(direction);
          const [x, y] = [from.dot(right), from.dot(above)];
          distance = Math.max(distance, Math.abs(x) / (0.9 * wide) + depth, Math.abs(y) / (0.82 * tall) + depth);
          left = Math.min(left, x);
          far = Math.max(far, x);
          low = Math.min(low, y);
          high = Math.max(high, y);
        }
        target.addScaledVector(right, (left + far) / 2).addScaledVector(above, (low + high) / 2);
      }
      distance = Math.max(distance, 0.15 * this.size);
      // What is thrown far is looked at from as far.
      controls.maxDistance = Math.max(60 * this.size, 4 * distance);
      camera.far = Math.max(400 * this.size, 2 * controls.maxDistance);
      camera.position.copy(target).addScaledVector(direction, distance);
      controls.target.copy(target);
    }
    camera.updateProjectionMatrix();
    controls.update();
  }

  startFollowing(at: Vector3): void {
    this.followed.copy(at);
  }

  follow(at: Vector3): void {
    const way = at.clone().sub(this.followed);
    this.followed.copy(at);
    this.camera.position.add(way);
    this.controls.target.add(way);
    this.controls.update();
  }
}
