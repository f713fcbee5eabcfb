// The list of what the model is made of, and the channels of what was picked.

import type { Channel, Run } from "./data";
import { Plot } from "./plot";
import { BODIES } from "./theme";

const GROUPS = [
  ["bodies", "Bodies"],
  ["joints", "Joints"],
  ["forces", "Forces"],
  ["drivers", "Drivers"],
  ["other", "Whole run"],
] as const;

/** What stands in the list: an item of the model, or a group of channels such as `energy`. */
interface Item {
  name: string;
  title: string;
  kind: string;
  color?: string;
  between: string;
}

export class Panel {
  private plots: Plot[] = [];
  private rows = new Map<string, HTMLElement>();
  private selection = document.getElementById("selection")!;
  private tree = document.getElementById("tree")!;

  constructor(
    private runs: Run[],
    private span: [number, number],
    private seek: (time: number) => void,
    private choose: (name: string | null) => void,
  ) {
    this.list();
    this.show(null);
    new ResizeObserver(() => this.plots.forEach((plot) => plot.draw())).observe(this.selection);
  }

  private items(group: string): Item[] {
    const run = this.runs[0];
    if (group === "bodies") {
      return run.bodies.map(({ name, title, kind }) => {
        const color = `#${BODIES[kind % BODIES.length].toString(16).padStart(6, "0")}`;
        return { name, title, kind: "body", color, between: "" };
      });
    }
    if (group === "other") {
      const known = new Set([...run.bodies, ...run.elements].map((one) => one.name));
      const names = new Set(run.channels.map((channel) => channel.item).filter((name) => !known.has(name)));
      return [...names].map((name) => ({ name, title: "", kind: "", between: "" }));
    }
    return run.elements
      .filter((element) => element.collection === group)
      .map((element) => ({
        name: element.name,
        title: element.title,
        kind: element.type.replace(/_/g, " "),
        between: element.frames
          .map((frame) => (frame.body === null ? "ground" : run.bodies[frame.body].name))
          .join(" – "),
      }));
  }

  private list(): void {
    for (const [group, heading] of GROUPS) {
      const items = this.items(group);
      if (!items.length) continue;
      const details = document.createElement("details");
      details.open = group === "bodies" || this.runs[0].bodies.length + this.runs[0].elements.length < 24;
      const summary = document.createElement("summary");
      summary.textContent = heading;
      const count = document.createElement("span");
      count.textContent = String(items.length);
      summary.append(count);
      details.append(summary);
      for (const item of items) {
        const row = document.createElement("button");
        row.className = "row";
        row.title = item.between || item.title;
        const dot = document.createElement("i");
        if (item.color) dot.style.background = item.color;
        else dot.className = group;
        const name = document.createElement("span");
        name.textContent = item.name;
        const kind = document.createElement("small");
        kind.textContent = item.kind === "body" ? "" : item.kind;
        row.append(dot, name, kind);
        row.addEventListener("click", () => this.choose(item.name));
        details.append(row);
        this.rows.set(item.name, row);
      }
      this.tree.append(details);
    }
  }

  /** The smallest range that is drawn: a millionth of the largest number with that unit. */
  private floor(channel: Channel): number {
    let largest = 0;
    for (const one of this.runs[0].channels) {
      if (one.unit !== channel.unit) continue;
      for (let k = 0; k < one.low.length; k++) largest = Math.max(largest, Math.abs(one.low[k]), Math.abs(one.high[k]));
    }
    return 1e-6 * largest;
  }

  show(name: string | null): void {
    for (const [key, row] of this.rows) {
      row.setAttribute("aria-current", String(key === name));
      if (key === name) {
        (row.parentElement as HTMLDetailsElement).open = true;
      }
    }
    this.plots = [];
    this.selection.replaceChildren();
    const run = this.runs[0];
    const item = GROUPS.flatMap(([group]) => this.items(group)).find((one) => one.name === name);
    const head = document.createElement("div");
    head.className = "head";
    const title = document.createElement("h2");
    const note = document.createElement("p");
    if (item) {
      title.textContent = item.name;
      note.textContent = [item.title, item.kind, item.between].filter(Boolean).join(" · ");
      const close = document.createElement("button");
      close.textContent = "×";
      close.title = "back to the channels asked for (Esc)";
      close.addEventListener("click", () => this.choose(null));
      head.append(title, close);
    } else {
      title.textContent = "Channels";
      note.textContent = "Pick a body, joint or force to see its own.";
      head.append(title);
    }
    this.selection.append(head, note);
    const channels = run.channels.filter((channel) => (item ? channel.item === item.name : channel.asked));
    for (const channel of channels) {
      const lines = this.runs.flatMap((one, number) => {
        const same = one.channels.find((other) => other.name === channel.name && other.curves.length === channel.curves.length);
        return same ? [{ run: one, number, channel: same }] : [];
      });
      const plot = new Plot(lines, this.span, this.floor(channel), this.seek);
      if (!item) plot.root.querySelector("h3")!.prepend(`${channel.item} · `);
      this.plots.push(plot);
      this.selection.append(plot.root);
    }
    if (item && !channels.length) {
      const none = document.createElement("p");
      none.textContent = "It has no channels here.";
      this.selection.append(none);
    }
    this.selection.scrollTop = 0;
    this.plots.forEach((plot) => plot.draw());
  }

  /** To be called when rows have come: the same channels, to the new end. */
  refresh(name: string | null): void {
    const { scrollTop } = this.selection;
    this.show(name);
    this.selection.scrollTop = scrollTop;
  }

  redraw(): void {
    this.plots.forEach((plot) => plot.draw());
  }

  move(time: number): void {
    for (const plot of this.plots) plot.move(time);
  }
}
