/** Name, scene, model, how the link does, and the switches of the page. */

import { Caution } from "../caution";
import type { Desk } from "../desk";
import { h, toggle, write } from "../dom";
import { icon, logo } from "../icons";
import { actionButton, toggleButton } from "./buttons";
import { modelSwitch } from "./models";
import { scenePicker } from "./picker";
import { RunStrip } from "./run";
import { TissueMenu } from "./tissue";
import { VerdictBar } from "./verdict";

const EVERY = 100;
const SECOND = 1000;

export class Header {
  private readonly latency = h("output", { class: "latency", "aria-label": "Latency", "aria-live": "off" }, "–");
  private readonly rate = h("output", { class: "rate", "aria-label": "Frame rate", "aria-live": "off" }, "–");
  private readonly state = h("span", { class: "state" });
  private readonly meters = h(
    "p",
    { class: "meters" },
    h("span", { class: "meter" }, h("span", { class: "name" }, "Latency"), icon("warning", 13), this.latency, h("span", { class: "unit" }, "ms")),
    h("span", { class: "meter" }, icon("warning", 13), this.rate, h("span", { class: "unit" }, "fps")),
    this.state,
  );
  readonly element: HTMLElement;
  private readonly tissue: TissueMenu;
  private readonly run: RunStrip;
  readonly slow = new Caution(100, SECOND);
  private readonly verySlow = new Caution(250, SECOND);
  private readonly few = new Caution(1, SECOND);
  private writtenAt = -Infinity;

  constructor(private readonly desk: Desk) {
    this.tissue = new TissueMenu(desk);
    this.run = new RunStrip(desk.trainer);
    this.element = h(
      "header",
      { class: "header" },
      h("h1", {}, logo(), h("span", {}, "Sonospline")),
      scenePicker(desk.trainer),
      modelSwitch(desk),
      this.tissue.element,
      this.run.element,
      new VerdictBar(desk.trainer).element,
      h("span", { class: "space" }),
      this.meters,
      toggleButton(desk, "guides", "Guides", "eye", "quiet"),
      actionButton(desk, "reset", "Reset", "clockwise", "quiet"),
      actionButton(desk, "help", "Help", null, "help"),
    );
    this.element.querySelector(".help")?.prepend(h("b", { "aria-hidden": "true" }, "?"));
  }

  /** The latency that is shown, ms; null before the first pose. */
  get latencyNow(): number | null {
    return this.desk.session.meter.latency(performance.now());
  }

  tick(now: number): void {
    this.tissue.tick(now);
    this.run.tick(now);
    if (now - this.writtenAt < EVERY) return;
    this.writtenAt = now;
    const { status, meter } = this.desk.session;
    const live = status === "live";
    write(this.state, live ? "" : { connecting: "Connecting", loading: "Loading", frozen: "Frozen", lost: "Not connected" }[status]);
    this.meters.dataset.status = status;
    const latency = meter.latency(now);
    const rate = meter.rate(now);
    write(this.latency, live && latency !== null ? latency.toFixed(0) : "–");
    write(this.rate, live ? String(rate) : "–");
    if (latency !== null) this.latency.dataset.value = latency.toFixed(3);
    this.rate.dataset.value = String(rate);
    const felt = live && meter.fresh(now) ? (latency ?? 0) : 0;
    this.slow.update(felt, now);
    this.verySlow.update(felt, now);
    // an idle scene sends few frames on purpose: count only what answers a hand
    this.few.update(live && this.desk.motion.moving ? 15 / Math.max(rate, 0.1) : 0, now);
    const [first, second] = this.meters.children;
    toggle(first, "caution", this.slow.on);
    toggle(first, "fault", this.verySlow.on);
    toggle(second, "caution", this.few.on);
  }
}
