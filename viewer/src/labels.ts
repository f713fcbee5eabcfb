// Names in the picture: one that would cover another is left out.

import { Vector3, type Camera } from "three";

interface Label {
  name: string;
  at: Vector3;
  strong: boolean;
}

export class Labels {
  private root = document.getElementById("names")!;
  private kept = new Map<string, { element: HTMLElement; width: number }>();

  move(labels: Label[], camera: Camera, width: number, height: number): void {
    const seen = new Set<string>();
    const taken: [number, number, number, number][] = [];
    const p = new Vector3();
    for (const label of [...labels].sort((a, b) => Number(b.strong) - Number(a.strong))) {
      p.copy(label.at).project(camera);
      if (p.z > 1 || Math.abs(p.x) > 1 || Math.abs(p.y) > 1) continue;
      const entry = this.entry(label.name);
      const x = ((p.x + 1) / 2) * width + 8;
      const y = ((1 - p.y) / 2) * height - 22;
      const box: [number, number, number, number] = [x, y, x + entry.width, y + 18];
      if (taken.some((b) => box[0] < b[2] && box[2] > b[0] && box[1] < b[3] && box[3] > b[1])) continue;
      taken.push(box);
      seen.add(label.name);
      entry.element.className = label.strong ? "strong" : "";
      entry.element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
      entry.element.hidden = false;
    }
    for (const [name, { element }] of this.kept) if (!seen.has(name)) element.hidden = true;
  }

  private entry(name: string) {
    let entry = this.kept.get(name);
    if (!entry) {
      const element = document.createElement("span");
      element.textContent = name;
      this.root.append(element);
      entry = { element, width: element.offsetWidth };
      this.kept.set(name, entry);
    }
    return entry;
  }
}
