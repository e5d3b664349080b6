import { beforeEach, describe, expect, it, vi } from "vitest";
import type { Connection } from "../src/connection";
import { clock, number, title, wanted, withUnit } from "../src/metrics";
import { PROTOCOL, type Debrief, type FrameHeader, type OfferedExercise, type Scene, type StationMessage } from "../src/protocol";
import { Session } from "../src/session";
import { Trainer } from "../src/trainer";
import { command, push } from "./knobs";
import { Wire } from "./wire";

describe("metrics in words", () => {
  it("leaves the unit out of a name and puts it behind the number", () => {
    expect(title("blind_advance_mm")).toBe("Blind advance");
    expect(title("tissue_swept_mm2")).toBe("Tissue swept");
    expect(title("needle_motion_smoothness_mm_s3")).toBe("Needle motion smoothness");
    expect(title("passes")).toBe("Passes");
    expect([withUnit(19.26, "mm"), withUnit(12, "deg"), withUnit(64.4, "mm^2"), withUnit(null, "N"), withUnit(1, "")]).toEqual(["19.3 mm", "12°", "64.4 mm²", "–", "1"]);
  });

  it("keeps three digits that count, and no minus before nothing", () => {
    expect([number(0.0312), number(123.4), number(-2.5), number(-0.0), number(1000)]).toEqual(["0.031", "123", "−2.5", "0", "1000"]);
  });

  it("says what is wanted, and the time", () => {
    expect(wanted({ least: null, most: 8, unit: "mm" })).toBe("at most 8 mm");
    expect(wanted({ least: 85, most: null, unit: "%" })).toBe("at least 85 %");
    expect(wanted({ least: null, most: 0, unit: "" })).toBe("none");
    expect([clock(0), clock(59.9), clock(180), clock(-3)]).toEqual(["0:00", "0:59", "3:00", "0:00"]);
  });
});

describe("a trainer", () => {
  const exercise = { id: "toy", name: "Toy", guides: ["tip"] } as unknown as OfferedExercise;
  const scene = { type: "scene", id: "gel", name: "Gel", models: [], model: "paper", target: "t", knobs: [push], state: command, start: command, attempt: null, guides: ["path", "target", "tip", "numbers", "3-D view"] } as unknown as Scene;
  let wire: Wire;
  let session: Session;
  let trainer: Trainer;

  const show = (extra: Partial<FrameHeader> = {}) => {
    const header = { frame: 1, seq: 0, state: command, model: "paper", target: null, needle: null, readouts: null, log: [], replay: null, ...extra } as unknown as FrameHeader;
    wire.binary.emit({ kind: "frame", frame: { header, pixels: new Uint8Array(), positions: null, colour: null } });
    session.draw(performance.now());
  };

  beforeEach(() => {
    vi.stubGlobal("document", { hidden: false });
    wire = new Wire();
    session = new Session(wire as unknown as Connection);
    trainer = new Trainer(session);
    wire.opened.emit();
    wire.text.emit({ type: "hello", version: "1", protocol: PROTOCOL, scenes: [], session: "key", resumed: false });
    wire.text.emit(scene);
    show();
    wire.text.emit({ type: "exercises", offered: [exercise] });
  });

  it("has what a lab's trainer sets read, and shows comments without leaving the debrief's place", () => {
    const station: StationMessage = { type: "station", name: "3", participant: "K-17", exercise: "toy", guides_locked: false, models_locked: false, hands_locked: false, said: "", comments: [] };
    const changes: string[] = [];
    trainer.changed.on((phase) => changes.push(phase));
    wire.text.emit(station);
    expect([trainer.phase, trainer.briefed?.id]).toEqual(["briefing", "toy"]);
    trainer.brief(null);
    wire.text.emit({ ...station, said: "Sweep first" });
    expect(trainer.phase).toBe("practice");
    wire.text.emit({ ...scene, attempt: { exercise, seed: 5, recorded: "" }, guides: exercise.guides });
    wire.text.emit({ type: "debrief", exercise } as unknown as Debrief);
    const before = changes.length;
    wire.text.emit({ ...station, comments: [{ time_s: 2, text: "Good" }] });
    expect([trainer.phase, trainer.station?.comments.length, changes.length]).toEqual(["debrief", 1, before]);
  });

  it("lets only a lab's trainer let go on what that trainer has frozen", () => {
    const station: StationMessage = { type: "station", name: "3", participant: "K-17", exercise: null, guides_locked: false, models_locked: false, hands_locked: true, said: "", comments: [] };
    const frozen = () => wire.said.filter(({ type }) => type === "command").map((said) => "frozen" in said && said.frozen).at(-1);
    wire.text.emit({ ...scene, attempt: { exercise, seed: 5, recorded: "" }, guides: exercise.guides });
    show();
    session.flush(1e9);
    wire.text.emit(station);
    session.flush(2e9);
    expect([session.status, session.answers, frozen()]).toEqual(["frozen", false, true]);
    const said = wire.said.length;
    session.toggleFreeze();
    trainer.sayOnTarget();
    trainer.giveUp();
    session.flush(3e9);
    expect([session.status, wire.said.length]).toEqual(["frozen", said]);
    wire.text.emit({ ...station, hands_locked: false });
    session.flush(4e9);
    expect([session.status, frozen()]).toEqual(["live", false]);
  });

  it("asks for the exercises once there is a picture, and goes through its phases", () => {
    expect(wire.said.filter(({ type }) => type === "list_exercises")).toHaveLength(1);
    expect(trainer.phase).toBe("practice");
    trainer.brief(exercise);
    expect(trainer.phase).toBe("briefing");
    trainer.begin("toy");
    trainer.begin("toy");
    expect(wire.said.filter(({ type }) => type === "begin_attempt")).toEqual([{ type: "begin_attempt", exercise: "toy", seed: null }]);
    wire.text.emit({ ...scene, attempt: { exercise, seed: 5, recorded: "" }, guides: exercise.guides });
    show();
    expect([trainer.phase, trainer.count("toy")]).toEqual(["attempt", 1]);
    expect([session.allows("tip"), session.allows("target")]).toEqual([true, false]);
    trainer.sayOnTarget();
    expect(wire.said.at(-1)).toEqual({ type: "on_target" });
    wire.text.emit({ type: "debrief", exercise } as unknown as Debrief);
    expect([trainer.phase, session.allows("target"), session.answers]).toEqual(["debrief", true, false]);
  });

  it("can begin again after a refusal", () => {
    trainer.begin("toy");
    wire.text.emit({ type: "refused", what: "begin_attempt", message: "no", file: null, line: null, seq: null });
    trainer.begin("toy", 7);
    expect(wire.said.at(-1)).toEqual({ type: "begin_attempt", exercise: "toy", seed: 7 });
  });

  it("lets a recording move the hand, and nothing else", () => {
    wire.text.emit({ ...scene, attempt: { exercise, seed: 5, recorded: "" }, guides: exercise.guides });
    show();
    wire.text.emit({ type: "debrief", exercise } as unknown as Debrief);
    const deep = { ...command, needle: { ...command.needle, depth: 20 }, frozen: true };
    show({ state: deep, replay: { step: 3, time_s: 1, same: true } });
    expect([session.command?.needle.depth, session.status]).toEqual([20, "live"]);
    const said = wire.said.length;
    session.nudge("needle.depth", 1);
    session.toggleFreeze();
    session.flush(1e9);
    expect(wire.said.slice(said)).toEqual([]);
  });
});
