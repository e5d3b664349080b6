/** Exercises on the page: which there are, what is read before, what runs, and what came of it. */

import type { Comment, Debrief, OfferedExercise, RunningAttempt, ServerText, StationMessage } from "./protocol";
import type { Session } from "./session";
import { Signal } from "./signal";

export type Phase = "practice" | "briefing" | "attempt" | "debrief";

export class Trainer {
  offered: readonly OfferedExercise[] = [];
  /** What is read before it begins. */
  briefed: OfferedExercise | null = null;
  debrief: Debrief | null = null;
  /** In a lab: which station this is, and what its trainer has set. */
  station: StationMessage | null = null;
  /** Attempts that have begun on this page, by exercise. */
  private readonly counts = new Map<string, number>();
  readonly changed = new Signal<Phase>();
  /** On the attempt that is talked about: in a lab its trainer's, else those kept beside the recording. */
  comments: readonly Comment[] = [];
  readonly commented = new Signal<readonly Comment[]>();
  /** Something of the station has changed. */
  readonly stationed = new Signal<StationMessage>();
  /** Something was loading and does not come. */
  private waiting = false;

  constructor(readonly session: Session) {
    session.unheeded.on((message) => this.hear(message));
    session.sceneReady.on(({ attempt }) => {
      if (attempt && !session.resumed) this.counts.set(attempt.exercise.id, this.count(attempt.exercise.id) + 1);
      this.briefed = this.debrief = null;
      this.waiting = false;
      if (!this.station) this.take([]);
      this.changed.emit(this.phase);
    });
    session.refused.on(({ what }) => {
      if (what === "begin_attempt") this.waiting = false;
    });
    let asked = false;
    session.greeted.on(() => (asked = false));
    session.drawn.on(() => {
      if (!asked) session.say({ type: "list_exercises" });
      asked = true;
    });
  }

  get attempt(): RunningAttempt | null {
    return this.session.scene?.attempt ?? null;
  }

  get phase(): Phase {
    if (this.briefed) return "briefing";
    if (this.debrief) return "debrief";
    return this.attempt ? "attempt" : "practice";
  }

  /** How often an exercise was begun on this page. */
  count(id: string): number {
    return this.counts.get(id) ?? 0;
  }

  /** Have an exercise read; nothing is begun yet. */
  brief(exercise: OfferedExercise | null): void {
    this.briefed = exercise;
    this.changed.emit(this.phase);
  }

  /** `seed`: for the same start once more. */
  begin(id: string, seed: number | null = null): void {
    if (this.waiting) return;
    this.waiting = true;
    this.session.say({ type: "begin_attempt", exercise: id, seed });
  }

  sayOnTarget(): void {
    if (this.phase === "attempt" && !this.session.held) this.session.say({ type: "on_target" });
  }

  giveUp(): void {
    if (this.phase === "attempt" && !this.session.held) this.session.say({ type: "give_up" });
  }

  /** The one after this, as they are offered; the first after the last. */
  next(id: string): OfferedExercise | null {
    const at = this.offered.findIndex((one) => one.id === id);
    return this.offered[(at + 1) % this.offered.length] ?? null;
  }

  /** Have what the trainer has set read, where nothing else is under way. */
  private follow(): boolean {
    const set = this.offered.find(({ id }) => id === this.station?.exercise);
    if (!set || this.phase !== "practice") return false;
    this.briefed = set;
    return true;
  }

  /** The trainer has frozen the station, or lets it go on; the server sees to it whatever the page does. */
  private hold(on: boolean): void {
    const { session } = this;
    if (session.held === on) return;
    session.held = false;
    if (on !== (session.status === "frozen")) session.toggleFreeze();
    session.held = on;
  }

  private take(comments: readonly Comment[]): void {
    this.comments = comments;
    this.commented.emit(comments);
  }

  private hear(message: ServerText): void {
    if (message.type === "exercises") {
      this.offered = message.offered;
      this.follow();
      this.changed.emit(this.phase);
    }
    if (message.type === "station") {
      const before = this.station?.exercise ?? null;
      this.station = message;
      this.take(message.comments);
      this.hold(message.hands_locked);
      this.stationed.emit(message);
      if (message.exercise !== before && this.follow()) this.changed.emit(this.phase);
    }
    if (message.type === "comments") this.take(message.comments);
    if (message.type === "debrief") {
      this.session.reviewing = true;
      this.debrief = message;
      this.changed.emit(this.phase);
    }
  }
}
