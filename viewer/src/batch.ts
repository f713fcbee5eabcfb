// Everything that belongs to bodies, drawn in a handful of calls: triangles of all parts lie in common buffers, each
// corner knows its actor, and the places of all actors are one texture that is filled once per frame.

import {
  Box3, BufferAttribute, BufferGeometry, Color, DataTexture, DoubleSide, FloatType, Group, LineSegments,
  Matrix4, Mesh, MeshBasicMaterial, NearestFilter, Object3D, RGBAFormat,
  Vector3, type Intersection, type Raycaster,
} from "three";
import { actorMaterial, shadowMaterial } from "./surface";

/** How parts that are drawn together look. */
export interface Layer {
  kind: "body" | "force" | "joint" | "edge" | "axes" | "shadow";
  opacity?: number;
  /** Seen from behind, too: surfaces that may be open. */
  bothSides?: boolean;
  /** Of a run laid over the first one: it hides nothing. */
  ghost?: boolean;
}

interface Part {
  name: string;
  geometry: BufferGeometry;
  actor: Object3D;
}

interface Batch {
  layer: Layer;
  parts: Part[];
  object?: Mesh | LineSegments;
  /** What is picked, seen through what covers it. */
  through?: Mesh;
}

/** Actors per row of the texture; each takes three texels, the rows of its matrix. */
const ROW = 64;

export class Batches {
  readonly root = new Group();
  readonly shadows = new Group();
  private batches = new Map<string, Batch>();
  private slots = new Map<Object3D, number>();
  private items = new Map<string, number>([["", 0]]);
  private places = new Float32Array(0);
  private texture = new DataTexture();
  private picked = { value: -1 };
  private poses = { value: this.texture };
  /** Where places are counted from, so that single precision serves far from the origin. */
  private anchor = new Vector3();
  private thrown = { value: new Matrix4() };
  readonly shadowTint = { value: new Color() };
  readonly edgeTint = { value: new Color() };
  private probe = new Mesh(new BufferGeometry(), new MeshBasicMaterial({ side: DoubleSide }));

  add(layer: Layer, name: string, geometry: BufferGeometry, actor: Object3D): void {
    const key = JSON.stringify(layer);
    if (!this.batches.has(key)) this.batches.set(key, { layer, parts: [] });
    this.batches.get(key)!.parts.push({ name, geometry, actor });
    if (!this.slots.has(actor)) this.slots.set(actor, this.slots.size);
    if (!this.items.has(name)) this.items.set(name, this.items.size);
  }

  /** What throws a shadow; it is not seen itself. */
  addShadow(geometry: BufferGeometry, actor: Object3D): void {
    this.add({ kind: "shadow" }, "", geometry, actor);
  }

  build(): void {
    const rows = Math.max(1, Math.ceil(this.slots.size / ROW));
    this.places = new Float32Array(12 * ROW * rows);
    this.texture = new DataTexture(this.places, 3 * ROW, rows, RGBAFormat, FloatType);
    this.texture.minFilter = this.texture.magFilter = NearestFilter;
    this.poses.value = this.texture;
    for (const batch of this.batches.values()) this.assemble(batch);
  }

  private assemble(batch: Batch): void {
    const { layer, parts } = batch;
    const lines = layer.kind === "edge" || layer.kind === "axes";
    const unlit = lines || layer.kind === "shadow";
    const corners = parts.reduce((sum, part) => sum + part.geometry.getAttribute("position").count, 0);
    const indices = parts.reduce((sum, { geometry }) => sum + (geometry.index ?? geometry.getAttribute("position")).count, 0);
    const position = new Float32Array(3 * corners);
    const normal = new Int8Array(unlit ? 0 : 4 * corners);
    const color = new Uint8Array(4 * corners);
    const tag = new Uint16Array(2 * corners);
    const index = new Uint32Array(indices);
    let [corner, at] = [0, 0];
    for (const { geometry, name, actor } of parts) {
      const places = geometry.getAttribute("position");
      const faces = geometry.getAttribute("normal");
      const paint = geometry.getAttribute("color");
      const [slot, item] = [this.slots.get(actor)!, this.items.get(name)!];
      for (let i = 0; i < places.count; i++) {
        const k = corner + i;
        position.set([places.getX(i), places.getY(i), places.getZ(i)], 3 * k);
        if (!unlit) normal.set([127 * faces.getX(i), 127 * faces.getY(i), 127 * faces.getZ(i), 0], 4 * k);
        if (paint) color.set([255 * paint.getX(i), 255 * paint.getY(i), 255 * paint.getZ(i), 255], 4 * k);
        tag[2 * k] = slot;
        tag[2 * k + 1] = item;
      }
      const own = geometry.index;
      const count = own ? own.count : places.count;
      for (let i = 0; i < count; i++) index[at + i] = corner + (own ? own.getX(i) : i);
      corner += places.count;
      at += count;
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(position, 3));
    if (!unlit) geometry.setAttribute("normal", new BufferAttribute(normal, 4, true));
    geometry.setAttribute("color", new BufferAttribute(color, 4, true));
    geometry.setAttribute("tag", new BufferAttribute(tag, 2));
    geometry.setIndex(new BufferAttribute(index, 1));
    const uniforms = { poses: this.poses, picked: this.picked };
    const tint = layer.kind === "edge" ? this.edgeTint : this.shadowTint;
    const material = layer.kind === "shadow" ? shadowMaterial({ ...uniforms, thrown: this.thrown, tint }) : actorMaterial(layer, { ...uniforms, tint });
    batch.object = lines ? new LineSegments(geometry, material) : new Mesh(geometry, material);
    batch.object.frustumCulled = false;
    const order = { shadow: -2, axes: 5, edge: 0, body: layer.ghost ? 4 : 3, force: 0, joint: 0 };
    batch.object.renderOrder = order[layer.kind];
    if (layer.kind === "force" || layer.kind === "joint") {
      batch.through = new Mesh(geometry, actorMaterial(layer, uniforms, true));
      Object.assign(batch.through, { frustumCulled: false, renderOrder: 6, visible: false });
      this.root.add(batch.through);
    }
    if (layer.kind === "body" && (layer.opacity ?? 1) < 1 && !layer.ghost) {
      // Of what is seen through only the nearest surface is drawn: its depth goes ahead.
      const ahead = material.clone();
      Object.assign(ahead, { colorWrite: false, uniforms: material.uniforms });
      const depth = new Mesh(geometry, ahead);
      depth.frustumCulled = false;
      depth.renderOrder = 2;
      this.root.add(depth);
    }
    (layer.kind === "shadow" ? this.shadows : this.root).add(batch.object);
  }

  /** Takes the places of the actors, whose world matrices are up to date. */
  place(anchor: Vector3): void {
    this.anchor.copy(anchor);
    this.root.position.copy(anchor);
    for (const [actor, slot] of this.slots) {
      const m = actor.matrixWorld.elements;
      const at = 12 * slot;
      for (let row = 0; row < 3; row++) {
        for (let column = 0; column < 4; column++) this.places[at + 4 * row + column] = m[4 * column + row];
        this.places[at + 4 * row + 3] -= anchor.getComponent(row);
      }
    }
    this.texture.needsUpdate = true;
  }

  /** `view` maps ground axes to the picture, `shadow` throws points on the ground. */
  cast(view: Matrix4, shadow: Matrix4 | null): void {
    this.shadows.visible = shadow !== null;
    if (!shadow) return;
    const { x, y, z } = this.anchor;
    this.thrown.value.multiplyMatrices(view, shadow).multiply(new Matrix4().makeTranslation(x, y, z));
  }

  show(shown: (layer: Layer) => boolean): void {
    for (const { layer, object } of this.batches.values()) {
      if (object && layer.kind !== "shadow") object.visible = shown(layer);
    }
  }

  pick(name: string | null): void {
    this.picked.value = name === null ? -1 : (this.items.get(name) ?? -1);
    for (const { through, parts } of this.batches.values()) {
      if (through) through.visible = parts.some((part) => part.name === name);
    }
  }

  /** What a ray meets of the layers that are shown, the nearest first. */
  hits(ray: Raycaster): { name: string; distance: number; layer: Layer }[] {
    const found: { name: string; distance: number; layer: Layer }[] = [];
    for (const { layer, parts, object } of this.batches.values()) {
      if (!(object instanceof Mesh) || !object.visible || layer.ghost || layer.kind === "shadow") continue;
      for (const { name, geometry, actor } of parts) {
        const hits: Intersection[] = [];
        this.probe.geometry = geometry;
        this.probe.matrixWorld.copy(actor.matrixWorld);
        this.probe.raycast(ray, hits);
        const near = Math.min(...hits.map((hit) => hit.distance));
        if (hits.length) found.push({ name, distance: near, layer });
      }
    }
    return found.sort((a, b) => a.distance - b.distance);
  }

  /** The box around the parts of a body, in its axes. */
  around(name: string): Box3 | null {
    const box = new Box3();
    for (const { layer, parts } of this.batches.values()) {
      if (layer.kind !== "body") continue;
      for (const part of parts) {
        if (part.name === name) box.union(new Box3().setFromBufferAttribute(part.geometry.getAttribute("position") as BufferAttribute));
      }
    }
    return box.isEmpty() ? null : box;
  }
}
