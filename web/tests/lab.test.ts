import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Lab, type LabHello, type LabText } from "../src/lab/lab";
import { PROTOCOL, type Scene } from "../src/protocol";
import { Session } from "../src/session";
import { command } from "./knobs";

class Socket {
  static readonly OPEN = 1;
  static made: Socket[] = [];
  readyState = 0;
  onopen = (): void => undefined;
  constructor() {
    Socket.made.push(this);
  }
  open(): void {
    this.readyState = 1;
    this.onopen();
  }
  send(): void {}
  close(): void {}
}

const hello: LabHello = { type: "lab_hello", protocol: PROTOCOL, results: "course.db", course: "Tuesday", exercises: [] };
const scene = { type: "scene", id: "gel", name: "Gel", models: [], model: "paper", target: "t", knobs: [], state: command, start: command, attempt: null, guides: [] } as unknown as Scene;

describe("a lab", () => {
  beforeEach(() => {
    vi.useFakeTimers();
    Socket.made = [];
    vi.stubGlobal("WebSocket", Socket);
    vi.stubGlobal("window", globalThis);
    vi.stubGlobal("document", { hidden: false });
  });

  afterEach(() => {
    vi.useRealTimers();
    vi.unstubAllGlobals();
  });

  it("opens another socket where nobody answers on one, and gives that time to answer", () => {
    const lab = new Lab("http://127.0.0.1/trainer.html?trainer=chalk");
    const session = new Session(lab.watching);
    const look = (seconds: number) => {
      for (let k = 0; k < 10 * seconds; k += 1) {
        vi.advanceTimersByTime(100);
        session.draw(performance.now());
      }
    };
    lab.link.open();
    Socket.made[0].open();
    lab.link.text.emit(hello);
    lab.link.text.emit(scene as unknown as LabText);
    session.status = "live";
    look(9);
    expect(Socket.made).toHaveLength(1);
    look(20);
    expect([Socket.made.length, session.status]).toEqual([2, "lost"]);
    Socket.made[1].open();
    look(9);
    expect(Socket.made).toHaveLength(2);
  });

  it("warns of a server of another version", () => {
    const lab = new Lab("http://127.0.0.1/trainer.html");
    const heard: string[] = [];
    lab.refused.on((line) => heard.push(line));
    lab.link.text.emit(hello);
    lab.link.text.emit({ ...hello, protocol: 99 as unknown as LabHello["protocol"] });
    expect(heard).toEqual([`The server speaks version 99, this page ${PROTOCOL}: reload the page`]);
  });
});
