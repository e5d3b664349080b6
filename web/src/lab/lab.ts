/** What the trainer's page knows of a lab, and what it asks of it. */

import { Connection, type Link, type Loss } from "../connection";
import { compareVersions, type Binary, type ServerText, type Thumb } from "../protocol";
import { Signal } from "../signal";
import type { LabHello, Results, StationState, Stations, TrainerProtocol } from "../trainer.gen";

export type LabText = TrainerProtocol["server"];
export type LabAsked = TrainerProtocol["client"];
export type { CurveRow, LabHello, Results, StandingRow, StationState, Stations } from "../trainer.gen";

export class Lab {
  hello: LabHello | null = null;
  stations: readonly StationState[] = [];
  results: Results | null = null;
  /** Name of the station that is watched. */
  watched: string | null = null;
  today = true;
  /** Whether its 3-D view is shown. */
  meshes = false;

  readonly greeted = new Signal<LabHello>();
  readonly changed = new Signal<Stations>();
  readonly chosen = new Signal<string | null>();
  readonly thumb = new Signal<Thumb>();
  readonly found = new Signal<Results>();
  readonly refused = new Signal<string>();
  readonly lost = new Signal<Loss | null>();
  readonly link: Connection<LabText, LabAsked>;
  /** As a session takes it: what the watched station's page is sent. */
  readonly watching: Link;
  private exercise: string | null = null;
  private readonly over = new Map<string, boolean>();

  constructor(page: string) {
    this.link = new Connection<LabText, LabAsked>(page, null, "trainer");
    this.watching = readOnly(this.link);
    this.link.text.on((message) => this.hear(message));
    this.link.binary.on((message) => {
      if (message.kind === "thumb") this.thumb.emit(message.thumb);
      else this.watching.binary.emit(message);
    });
    this.link.broken.on((line) => this.refused.emit(line));
    this.link.lost.on((loss) => {
      this.lost.emit(loss);
      this.watching.lost.emit(loss);
    });
    this.link.opened.on(() => {
      this.lost.emit(null);
      if (this.watched !== null) this.watch(this.watched);
      this.ask();
    });
  }

  say(message: LabAsked): void {
    this.link.send(message);
  }

  station(name: string | null): StationState | null {
    return this.stations.find((one) => one.name === name) ?? null;
  }

  /** What is set sets the station that is watched, or all of them. */
  concerned(all: boolean): readonly StationState[] {
    return all ? this.stations : this.stations.filter(({ name }) => name === this.watched);
  }

  watch(name: string): void {
    this.watched = name;
    this.say({ type: "watch_station", station: name, meshes: this.meshes });
    this.chosen.emit(name);
  }

  /** Ask for what has been kept: of today or of all days, and the curves of an exercise. */
  ask(choice: { today?: boolean; exercise?: string } = {}): void {
    this.today = choice.today ?? this.today;
    this.exercise = choice.exercise ?? this.exercise;
    this.say({ type: "list_results", today: this.today, exercise: this.exercise });
  }

  private hear(message: LabText): void {
    switch (message.type) {
      case "lab_hello":
        this.hello = message;
        compareVersions(message.protocol, this.link.broken);
        this.link.settle();
        return this.greeted.emit(message);
      case "stations":
        return this.take(message);
      case "results":
        this.results = message;
        return this.found.emit(message);
      case "refused":
        return this.refused.emit(message.message);
      default:
        return this.watching.text.emit(message as ServerText);
    }
  }

  private take(message: Stations): void {
    this.stations = message.stations;
    this.changed.emit(message);
    // the first that somebody sits at is looked at, until the trainer chooses
    if (this.watched === null) {
      const first = message.stations.find(({ state }) => state !== "empty");
      if (first) this.watch(first.name);
    }
    const ended = message.stations.filter(({ name, state }) => state === "debrief" && this.over.get(name) === false);
    for (const { name, state } of message.stations) this.over.set(name, state === "debrief");
    if (ended.length && message.waiting === 0) this.ask();
    else if (ended.length) window.setTimeout(() => this.ask(), KEPT);
  }
}

/** ms that a result takes to be kept. */
const KEPT = 600;

/** A link that says nothing to the station but that its pictures were drawn; where nobody answers it is given up, and opens again by itself. */
function readOnly(link: Connection<LabText, LabAsked>): Link {
  return {
    text: new Signal<ServerText>(), binary: new Signal<Binary>(), opened: new Signal<void>(), lost: new Signal<Loss>(), broken: link.broken,
    get isOpen() {
      return link.isOpen;
    },
    session: null,
    send: (message) => (message.type === "drawn" || message.type === "ping") && link.send(message),
    settle: () => undefined,
    open: () => undefined,
    abandon: (reason) => link.abandon(reason),
  };
}
