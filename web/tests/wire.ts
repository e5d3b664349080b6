/** A connection without a socket: what the server says is emitted, what the page says is kept. */

import type { Loss } from "../src/connection";
import type { Binary, ClientText, ServerText } from "../src/protocol";
import { Signal } from "../src/signal";

export class Wire {
  readonly text = new Signal<ServerText>();
  readonly binary = new Signal<Binary>();
  readonly opened = new Signal<void>();
  readonly lost = new Signal<Loss>();
  readonly broken = new Signal<string>();
  readonly said: ClientText[] = [];
  isOpen = true;
  session: string | null = null;

  send(message: ClientText): boolean {
    this.said.push(message);
    return true;
  }

  settle(): void {}
}
