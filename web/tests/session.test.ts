import { beforeEach, describe, expect, it, vi } from "vitest";
import type { Connection } from "../src/connection";
import { PROTOCOL, type FrameHeader, type Hello, type Knob, type Scene } from "../src/protocol";
import { Session } from "../src/session";
import { command, gain, knob, push, slide } from "./knobs";
import { Wire } from "./wire";

const persistence: Knob = knob("image.persistence", { keys: ["KeyT", "KeyY"], low: 0, high: 4, step: 1, setting: true });
const start = { ...command, image: { ...command.image, persistence: 1 } };
const scene = { type: "scene", id: "toy", name: "Toy", models: [], model: "paper", target: "t", knobs: [push, slide, gain, persistence], state: start, start } as unknown as Scene;
const hello: Hello = { type: "hello", version: "1", protocol: PROTOCOL, scenes: [], session: "key", resumed: false };

describe("a session", () => {
  let wire: Wire;
  let session: Session;
  let seq = 0;

  const show = (state: typeof start) => {
    seq += 1;
    const header = { frame: seq, seq: wire.said.filter(({ type }) => type === "command").length, state, model: "paper", target: { id: "t" }, log: [] } as unknown as FrameHeader;
    wire.binary.emit({ kind: "frame", frame: { header, pixels: new Uint8Array(), positions: null, colour: null } });
    session.draw(1000 * seq);
  };

  beforeEach(() => {
    vi.stubGlobal("document", { hidden: false });
    wire = new Wire();
    session = new Session(wire as unknown as Connection);
    wire.opened.emit();
    wire.text.emit(hello);
    wire.text.emit(scene);
    show(start);
  });

  it("stays lost where a frame came before the connection was, and was not drawn", () => {
    const header = { frame: 99, seq: 0, state: start, model: "paper", target: { id: "t" }, log: [] } as unknown as FrameHeader;
    wire.binary.emit({ kind: "frame", frame: { header, pixels: new Uint8Array(), positions: null, colour: null } });
    wire.lost.emit({ attempt: 0, nextAt: 0, reason: "taken over" });
    session.draw(1e6);
    expect(session.status).toBe("lost");
  });

  it("moves a knob it has never heard of, within its limits, and tells the server", () => {
    expect(session.value("image.persistence")).toBe(1);
    session.nudge("image.persistence", 7);
    const last = wire.said.at(-1);
    expect(last?.type === "command" && last.image).toEqual({ ...command.image, persistence: 4 });
    expect(session.command?.needle).toBe(start.needle);
  });

  it("follows the server where it does not", () => {
    const ends: string[] = [];
    session.limited.on(([{ id }, sign]) => ends.push(`${id} ${sign}`));
    session.nudge("image.persistence", 2);
    show({ ...start, image: { ...start.image, persistence: 2 } });
    expect(session.value("image.persistence")).toBe(2);
    expect(ends).toEqual(["image.persistence 1"]);
  });

  it("says so where a scene lacks a knob that a gesture asks for", () => {
    expect(() => session.knob("probe.tilt")).toThrow("the server says nothing of the knob probe.tilt");
  });

  it("warns of a server of another version", () => {
    const heard: string[] = [];
    wire.broken.on((message) => heard.push(message));
    wire.text.emit({ ...hello, protocol: 99 as unknown as Hello["protocol"] });
    expect(heard).toEqual([`The server speaks version 99, this page ${PROTOCOL}: reload the page`]);
  });

  it("tells of each event once, of frames that were not sent too, and of none from before it came", () => {
    const heard: string[] = [];
    session.happened.on(({ text }) => heard.push(text));
    const log = (...numbers: number[]) => numbers.map((number) => ({ number, text: `event ${number}`, depth: 1 }));
    const send = (...numbers: number[]) => {
      seq += 1;
      const header = { frame: seq, seq: 0, state: start, model: "paper", target: { id: "t" }, log: log(...numbers) } as unknown as FrameHeader;
      wire.binary.emit({ kind: "frame", frame: { header, pixels: new Uint8Array(), positions: null, colour: null } });
      session.draw(1000);
    };
    send(1, 2);
    send(1, 2);
    send(1, 2, 3, 4);
    expect(heard).toEqual(["event 1", "event 2", "event 3", "event 4"]);
    send(1, 2); // a reset was taken back
    send(1, 2, 3);
    expect(heard.slice(4)).toEqual(["event 3"]);
    wire.text.emit(scene);
    send(7, 8);
    expect(heard.length).toBe(5);
  });

  it("turns a switch of the tissue, or says why not", () => {
    const said: string[] = [];
    session.noticed.on(({ message }) => said.push(message));
    expect(session.turn("remember")).toBe("paper knows no time");
    expect(said).toEqual(["paper knows no time"]);
    scene.models.push({ id: "paper", name: "Paper", time: true, forces: true });
    expect(session.turn("remember")).toBeNull();
    expect(wire.said.filter(({ type }) => type === "command").at(-1)).toMatchObject({ tissue: { contact: "track" } });
    scene.models.pop();
  });
});
