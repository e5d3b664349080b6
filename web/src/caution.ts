/** A colour comes after its cause has lasted, and goes only well below the limit: nothing flickers. */

export class Caution {
  private since: number | null = null;
  on = false;

  /** `delay` ms the cause must last; `ease` is the share below the limit at which it goes. */
  constructor(
    private readonly limit: number,
    private readonly delay = 300,
    private readonly ease = 0.1,
  ) {}

  update(value: number, now: number, limit = this.limit): boolean {
    if (this.on) this.on = value > limit * (1 - this.ease);
    else if (value <= limit) this.since = null;
    else {
      this.since ??= now;
      this.on = now - this.since >= this.delay;
    }
    if (!this.on && value <= limit) this.since = null;
    return this.on;
  }

  clear(): void {
    this.since = null;
    this.on = false;
  }
}
