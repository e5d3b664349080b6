/** A hand at the desk, and a server that answers late and stops the needle at bone: all of it by a clock of the test's. */

import { beforeEach, describe, expect, it, vi } from "vitest";
import { adopt } from "../src/command";
import type { Connection, Loss } from "../src/connection";
import { Desk } from "../src/desk";
import { PUSH } from "../src/knobs";
import type { Pace } from "../src/motion";
import { stopped } from "../src/parts/words";
import { PROTOCOL, type Binary, type ClientText, type Command, type FrameHeader, type Scene, type ServerText } from "../src/protocol";
import { Session } from "../src/session";
import { Signal } from "../src/signal";
import { Trainer } from "../src/trainer";
import { command, gain, push, slide } from "./knobs";

const FRAME = 1000 / 60;
const BONE = 40;
const start: Command = { ...command, needle: { ...command.needle, depth: 0 } };

/** Takes the newest command, needs so many ms for its frame, and lets no needle into bone. */
class SlowServer {
  readonly text = new Signal<ServerText>();
  readonly binary = new Signal<Binary>();
  readonly opened = new Signal<void>();
  readonly lost = new Signal<Loss>();
  readonly broken = new Signal<string>();
  readonly asked: number[] = [];
  isOpen = true;
  session: string | null = null;
  shown = 0;
  lead = 0;
  private newest = { seq: 0, command: start };
  private working: { seq: number; command: Command; until: number } | null = null;
  private frames = 0;

  constructor(private readonly takes: (frame: number) => number) {}

  send(message: ClientText): boolean {
    if (message.type !== "command") return true;
    const { seq, type: _, ...asked } = message;
    this.newest = { seq, command: asked };
    this.asked.push(asked.needle.depth);
    this.lead = Math.max(this.lead, Math.abs(asked.needle.depth - this.shown));
    return true;
  }

  settle(): void {}

  get atWorkOn(): number {
    return this.working?.command.needle.depth ?? 0;
  }

  tick(now: number): void {
    this.working ??= { ...this.newest, until: now + this.takes(this.frames) };
    if (now < this.working.until) return;
    const { seq, command: asked } = this.working;
    const state = { ...asked, needle: { ...asked.needle, depth: Math.min(asked.needle.depth, BONE) } };
    const blocked = asked.needle.depth >= BONE ? "bone" : null;
    this.working = null;
    this.frames += 1;
    const header = { frame: this.frames, seq, state, blocked, bone: blocked && "rib_left_8", model: "paper", target: { id: "t" }, log: [] } as unknown as FrameHeader;
    this.binary.emit({ kind: "frame", frame: { header, pixels: new Uint8Array(), positions: null, colour: null } });
    this.shown = state.needle.depth;
  }
}

const scene = { type: "scene", id: "toy", name: "Toy", models: [], model: "paper", target: "t", knobs: [push, slide, gain], state: start, start } as unknown as Scene;

describe("a server that is late", () => {
  let now = 0;

  beforeEach(() => {
    now = 0;
    vi.stubGlobal("document", { hidden: false });
    vi.stubGlobal("localStorage", { getItem: () => null, setItem: () => undefined });
    vi.spyOn(performance, "now").mockImplementation(() => now);
  });

  const begin = (takes: (frame: number) => number) => {
    const server = new SlowServer(takes);
    const session = new Session(server as unknown as Connection);
    const desk = new Desk(session, new Trainer(session));
    server.opened.emit();
    server.text.emit({ type: "hello", version: "1", protocol: PROTOCOL, scenes: [], session: "key", resumed: false });
    server.text.emit(scene);
    const pass = (seconds: number, hand: () => void = () => undefined) => {
      for (const end = now + 1000 * seconds; now < end; now += FRAME) {
        server.tick(now);
        hand();
        desk.advance(FRAME / 1000);
        session.flush(now);
        session.draw(now);
      }
    };
    pass(1);
    expect(session.answers).toBe(true);
    return { server, session, desk, pass };
  };

  const late: readonly [string, (frame: number) => number][] = [
    ["20 ms", () => 20],
    ["300 ms", () => 300],
    ["5.4 s on its first push, then 25 ms", (frame) => (frame === 1 ? 5400 : 25)],
    ["never again", (frame) => (frame === 0 ? 0 : Infinity)],
  ];
  const hands: readonly [string, (desk: Desk) => void][] = [
    ["a key", (desk) => desk.press("ArrowDown", PUSH, 1)],
    ["a key and a button", (desk) => [desk.press("ArrowDown", PUSH, 1), desk.press("button", PUSH, 1)]],
    ["a trigger", (desk) => desk.drive("pad", PUSH, 2)],
    ["a place to go to", (desk) => desk.goTo(PUSH, 150)],
    ["tap after tap", (desk) => desk.tap(PUSH, 1)],
  ];

  for (const pace of ["slow", "normal", "fast"] satisfies Pace[]) {
    for (const [name, hand] of hands) {
      it.each(late)(`is led by at most 2 mm by ${name} at ${pace} speed: %s`, (_, takes) => {
        const { server, desk, pass } = begin(takes);
        desk.choosePace(pace);
        pass(8, () => hand(desk));
        expect(server.lead).toBeGreaterThan(0.09);
        expect(server.lead).toBeLessThanOrEqual(2 + 1e-6);
        expect(Math.max(...server.asked)).toBeLessThanOrEqual(BONE + 2 + 1e-6);
      });
    }
  }

  it("does not have a key that is held down wind up against bone", () => {
    const { server, session, desk, pass } = begin(() => 300);
    desk.choosePace("fast");
    desk.press("ArrowDown", PUSH, 1);
    pass(30);
    expect(session.value(PUSH)).toBe(BONE);
    const asked = server.asked.length;
    pass(5);
    expect(server.asked.length).toBe(asked);
  });

  it("does not push a needle back in that was turned back before its word of the bone came", () => {
    const { server, session, desk, pass } = begin(() => 400);
    desk.press("ArrowDown", PUSH, 1);
    pass(30);
    desk.release("ArrowDown");
    desk.tap(PUSH, 1);
    while (server.atWorkOn <= BONE) pass(FRAME / 1000);
    const since = server.asked.length;
    desk.press("ArrowUp", PUSH, -1);
    pass(3);
    const asked = server.asked.slice(since);
    expect(asked.length).toBeGreaterThan(5);
    expect(asked).toEqual([...asked].sort((a, b) => b - a));
    expect(session.value(PUSH)).toBeLessThan(BONE - 4);
  });
});

describe("what the server did not follow", () => {
  const at = (depth: number): Command => ({ ...command, needle: { ...command.needle, depth } });

  it.each([
    ["is where the hand is put", 45, 45, 40, 40],
    ["leaves a hand that turned back", 38, 45, 40, 38],
    ["holds one that went on", 46, 45, 40, 40],
    ["counts downwards, too", 0, 0, 30, 30],
    ["and leaves one there that came up", 35, 0, 30, 35],
  ])("%s", (_, now, sent, state, next) => {
    expect(adopt(at(now), at(sent), at(state)).needle.depth).toBe(next);
  });
});

describe("what stops a needle", () => {
  it("is said in words", () => {
    expect(stopped({ blocked: "bone", bone: "rib_left_8", held_by: null })).toEqual(["Bone: left rib 8", "The needle stops here: pull it back"]);
    expect(stopped({ blocked: "bone", bone: "vertebrae_L1", held_by: null })?.[0]).toBe("Bone: vertebrae L1");
    expect(stopped({ blocked: "bone", bone: "label 7", held_by: null })?.[0]).toBe("Bone: label 7");
    expect(stopped({ blocked: "bone", bone: "bone", held_by: null })?.[0]).toBe("Bone");
    expect(stopped({ blocked: "leaves the tissue", bone: null, held_by: null })?.[0]).toBe("Leaves the tissue");
    expect(stopped({ blocked: "held", bone: null, held_by: "kidney_left" })).toEqual(["Turns no further", "Left kidney would tear: turn it back, or pull it out"]);
    expect(stopped({ blocked: null, bone: null, held_by: null })).toBeNull();
  });
});
