/** The socket: opens, reads, and opens again when it is lost. */

import { decode, type Binary, type ClientText, type ServerText } from "./protocol";
import { Signal } from "./signal";

/** Seconds before each attempt; the last one repeats. */
const RETRY = [0.5, 1, 2, 4, 5] as const;

export function retryDelay(attempt: number): number {
  return RETRY[Math.min(attempt, RETRY.length) - 1];
}

/** How a socket closes: idle for too long, against the rules, kept out, gone on in another page. */
const IDLE = 1001;
const POLICY = 1008;
const KEPT_OUT = 1006;
const TAKEN_OVER = 4001;
/** What is not tried again until the person says so. */
const FINAL: readonly number[] = [IDLE, TAKEN_OVER];
/** After these the server keeps no session. */
const FORGOTTEN: readonly number[] = [IDLE, POLICY, TAKEN_OVER];

/** Where the server listens: beside the page, with the page's own token, and the key of a session to come back to. */
export function liveAddress(page: string, session: string | null = null, door = "live"): string {
  const address = new URL(door, page);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  address.search = new URL(page).search;
  if (session) address.searchParams.set("session", session);
  address.hash = "";
  return address.href;
}

export interface Loss {
  attempt: number;
  /** `performance.now()` of the next attempt; null waits for the person. */
  nextAt: number | null;
  reason: string;
}

/** What a session needs of it. */
export type Link = Pick<Connection, "text" | "binary" | "opened" | "lost" | "broken" | "isOpen" | "session" | "send" | "settle" | "open" | "abandon">;

/** Of a page at a station by default; the trainer's says and hears other things, at a door of its own that is shut for good to who has not its key. */
export class Connection<Said = ServerText, Asked = ClientText> {
  readonly text = new Signal<Said>();
  readonly binary = new Signal<Binary>();
  readonly opened = new Signal<void>();
  readonly lost = new Signal<Loss>();
  /** The page and the server do not understand each other. */
  readonly broken = new Signal<string>();
  private socket: WebSocket | null = null;
  private timer = 0;
  private attempt = 0;

  /** `session`: the key of a session to come back to. */
  constructor(
    private readonly page: string,
    public session: string | null = null,
    private readonly door: "live" | "trainer" = "live",
  ) {}

  open(): void {
    window.clearTimeout(this.timer);
    this.drop();
    const socket = new WebSocket(liveAddress(this.page, this.session, this.door));
    let opened = false;
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => this.read(event.data as string | ArrayBuffer);
    socket.onopen = () => {
      opened = true;
      this.opened.emit();
    };
    socket.onclose = ({ code, reason }) => {
      const loss = this.again(code, reason);
      if (code === KEPT_OUT && !opened) void this.askWhy(loss);
    };
    this.socket = socket;
  }

  /** Everything works again: the next loss starts with the shortest wait. */
  settle(): void {
    this.attempt = 0;
  }

  get isOpen(): boolean {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  send(message: Asked): boolean {
    if (!this.isOpen) return false;
    this.socket?.send(JSON.stringify(message));
    return true;
  }

  /** Give up a socket that says nothing any more. */
  abandon(reason: string): void {
    this.drop();
    this.again(0, reason);
  }

  private drop(): void {
    if (!this.socket) return;
    this.socket.onclose = this.socket.onmessage = this.socket.onopen = null;
    this.socket.close();
    this.socket = null;
  }

  private read(data: string | ArrayBuffer): void {
    try {
      if (typeof data === "string") this.text.emit(JSON.parse(data) as Said);
      else this.binary.emit(decode(data));
    } catch (error) {
      if (!(error instanceof RangeError || error instanceof SyntaxError)) throw error;
      this.broken.emit(`A message of the server could not be read: ${error.message}`);
    }
  }

  private again(code: number, reason: string): Loss {
    this.socket = null;
    this.attempt += 1;
    if (FORGOTTEN.includes(code)) this.session = null;
    const wait = FINAL.includes(code) ? null : retryDelay(this.attempt);
    if (wait !== null) this.timer = window.setTimeout(() => this.open(), 1000 * wait);
    const nextAt = wait === null ? null : performance.now() + 1000 * wait;
    const loss = { attempt: this.attempt, nextAt, reason: reason || (code === IDLE ? "idle for too long" : "") };
    this.lost.emit(loss);
    return loss;
  }

  /** A socket that never opened does not say why; a plain request of the same address does, where somebody is there. */
  private async askWhy(loss: Loss): Promise<void> {
    const address = liveAddress(this.page, null, this.door).replace(/^ws/, "http");
    const answer = await fetch(address).catch(() => null);
    if (answer?.status !== 403 && answer?.status !== 503) return;
    loss.reason = (await answer.text()).trim().replace(/\.$/, "");
    if (this.door === "live" || answer.status !== 403) return;
    window.clearTimeout(this.timer);
    loss.nextAt = null;
    this.lost.emit(loss);
  }
}
