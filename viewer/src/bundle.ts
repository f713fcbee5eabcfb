// All symbols that are fixed in one body as a single mesh: drawing many small ones costs more than
// drawing their triangles. What is picked is a group of its own.

import { BufferGeometry, Mesh, type Object3D } from "three";
import { merge } from "./geometry";
import { markedOf, surface } from "./surface";

interface Part {
  name: string;
  joint: boolean;
  geometry: BufferGeometry;
  start: number;
  count: number;
}

export class Bundle {
  mesh = new Mesh();
  private parts: Part[] = [];

  add(name: string, geometry: BufferGeometry, joint: boolean): void {
    this.parts.push({ name, joint, geometry, start: 0, count: 0 });
  }

  build(holder: Object3D): void {
    // Joints come last, so that they can be left out.
    this.parts.sort((a, b) => Number(a.joint) - Number(b.joint));
    let start = 0;
    for (const part of this.parts) {
      part.start = start;
      part.count = part.geometry.index!.count;
      start += part.count;
    }
    this.mesh = new Mesh(merge(this.parts.map((part) => part.geometry)), surface());
    holder.add(this.mesh);
  }

  /** What is large enough to throw a shadow: tyres, not joints. */
  get solid(): BufferGeometry | null {
    const parts = this.parts.filter((part) => !part.joint);
    return parts.length ? merge(parts.map((part) => part.geometry)) : null;
  }

  show(joints: boolean): void {
    const forces = this.parts.filter((part) => !part.joint);
    const count = forces.reduce((sum, part) => sum + part.count, 0);
    this.mesh.geometry.setDrawRange(0, joints ? Infinity : count);
  }

  mark(name: string | null): void {
    const { geometry } = this.mesh;
    const own = surface();
    geometry.clearGroups();
    const picked = this.parts.filter((part) => part.name === name);
    this.mesh.material = picked.length ? [own, markedOf(own)] : own;
    if (!picked.length) return;
    for (const part of this.parts) geometry.addGroup(part.start, part.count, part.name === name ? 1 : 0);
  }

  nameAt(face: number): string {
    return this.parts.find((part) => 3 * face < part.start + part.count)?.name ?? "";
  }
}
