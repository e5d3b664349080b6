/** Whether the server is still there: it is asked for a sign of life when it says nothing. */

/** ms without a sign of life before one is asked for, before the image counts as lost, before the socket is given up. */
const QUIET = 1000;
const SILENT = 3000;
const DEAD = 10000;
/** ms between two looks at the clock that mean the page stood still. */
const HELD_UP = 500;

export interface Patient {
  /** There is a socket that could be given up. */
  open: boolean;
  /** An image is awaited. */
  live: boolean;
  /** The image counts as lost, but the socket is open. */
  silent: boolean;
  ping: () => void;
  /** Given up at that time. */
  lose: (until: number) => void;
  abandon: () => void;
}

export class Heartbeat {
  heardAt = 0;
  private pingedAt = 0;
  private watchedAt = 0;

  watch(now: number, { open, live, silent, ping, lose, abandon }: Patient): void {
    // a page that was held up itself has not read what came meanwhile
    if (now - this.watchedAt > HELD_UP) this.heardAt += now - this.watchedAt;
    this.watchedAt = now;
    if (document.hidden || !open) this.heardAt = now;
    if ((document.hidden || !live) && !silent) return;
    const quiet = now - this.heardAt;
    if (quiet > QUIET && now - this.pingedAt > QUIET) {
      this.pingedAt = now;
      ping();
    }
    if (quiet > DEAD) abandon();
    else if (quiet > SILENT && live) lose(this.heardAt + DEAD);
  }
}
