/** The page: one session, its parts, and one loop. */

import { Connection } from "./connection";
import { Desk } from "./desk";
import { h } from "./dom";
import { parallel } from "./image/sector";
import { returnFocus } from "./input/focus";
import { GamepadReader } from "./input/gamepad";
import { handleInput } from "./input/handle";
import { listenToKeyboard } from "./input/keyboard";
import { scaleInput } from "./input/scale";
import { chooseLayout, type Layout } from "./layouts";
import { Announcer } from "./parts/announce";
import { Briefing } from "./parts/briefing";
import { debriefPanel } from "./parts/debrief";
import { Calliper } from "./parts/calliper";
import { dock, shorten } from "./parts/dock";
import { Header } from "./parts/header";
import { helpDialog } from "./parts/help";
import { hints } from "./parts/hints";
import { ImagePane, needleRight } from "./parts/imagePane";
import { LostPanel } from "./parts/lost";
import { NoticePart } from "./parts/notice";
import { PassPanel } from "./parts/pass";
import { Player } from "./parts/player";
import { MotionPlot } from "./parts/plot";
import { imageBar, needleRail, probeRail } from "./parts/rails";
import { ReadoutsPart } from "./parts/readouts";
import { SitDown, StationTag } from "./parts/station";
import { RefusalSheet } from "./parts/refusal";
import { tapped, ViewPane } from "./parts/viewPane";
import { Reel } from "./reel";
import { Session } from "./session";
import { Trainer } from "./trainer";
import { leaveKey, takeKey } from "./sessionKey";
import "./styles/tokens.css";
import "./styles/controls.css";
import "./styles/layout.css";
import "./styles/image.css";
import "./styles/panels.css";
import "./styles/tablet.css";
import "./styles/portrait.css";
import "./styles/small.css";
import "./styles/help.css";
import "./styles/training.css";
import "./styles/debrief.css";
import "./styles/preferences.css";

/** s: a tab that slept must not jump. */
const LONGEST_STEP = 0.1;
/** ms between steps without an image where a processor draws the page: the image needs it too. */
const SLOW_PACE = 60;

const link = new Connection(location.href, takeKey());
leaveKey(() => link.session);
const session = new Session(link);
const trainer = new Trainer(session);
const desk = new Desk(session, trainer);

const header = new Header(desk);
const image = new ImagePane(session, desk);
const readouts = new ReadoutsPart(session, desk);
const notice = new NoticePart(desk, header, image);
const lost = new LostPanel(session, image.element);
const view = new ViewPane(desk);
const plot = new MotionPlot(session);
const pass = new PassPanel(trainer);
const picker = header.element.querySelector<HTMLElement>(".picker");
const briefing = new Briefing(trainer);
const reel = new Reel(trainer);
const player = new Player(trainer, reel, () => image.refreshMarks());
const sheet = new RefusalSheet(session, picker ?? header.element);
const calliper = new Calliper(image);
picker?.after(new StationTag(trainer).element);
const announcer = new Announcer(desk);
const pads = new GamepadReader(desk);
const controls = dock(desk);

document.body.append(
  header.element,
  probeRail(desk),
  h("main", { class: "stage" }, image.element, readouts.element, notice.element, calliper.element, player.element, briefing.element, new SitDown(trainer).element, lost.element),
  h("div", { class: "side" }, h("div", { class: "column" }, view.element, plot.element, pass.element, sheet.element), controls),
  needleRail(desk),
  imageBar(desk),
  debriefPanel(trainer, reel),
  helpDialog(desk),
  hints(),
  announcer.element,
);

const coarse = window.matchMedia("(pointer: coarse)");
let layout: Layout | null = null;
const arrange = () => {
  const next = chooseLayout(window.innerWidth, window.innerHeight, coarse.matches);
  if (next === layout) return;
  layout = next;
  document.body.dataset.layout = next;
  shorten(controls, next);
  image.use(next);
};
window.addEventListener("resize", arrange);
coarse.addEventListener("change", arrange);
arrange();
const dress = () => {
  document.body.classList.toggle("left-handed", desk.switches.leftHanded);
  document.body.classList.toggle("swapped", desk.switches.swapped);
  const { scene } = session;
  document.body.classList.toggle("needle-right", scene !== null && needleRight(scene) !== desk.switches.mirrored);
};
desk.switched.on(dress);
dress();
session.sceneReady.on((scene) => {
  dress();
  document.body.classList.toggle("parallel", parallel(scene.probe));
});
trainer.changed.on((phase) => {
  const before = document.body.dataset.phase;
  document.body.dataset.phase = phase;
  const marks = (["target", "path", "tip"] as const).some((guide) => session.allows(guide));
  document.body.classList.toggle("no-guides-at-all", !marks);
  for (const guide of ["numbers", "3-D view"] as const) document.body.classList.toggle(`no-${guide.slice(0, 3)}`, !session.allows(guide));
  if (phase === "attempt" && before !== "attempt") image.element.focus();
});
document.body.dataset.phase = trainer.phase;
trainer.stationed.on(({ models_locked }) => document.body.classList.toggle("models-locked", models_locked));
session.statusChanged.on((status) => (document.body.dataset.status = status));
document.body.dataset.status = session.status;

listenToKeyboard(desk, image.element);
returnFocus(image.element);
handleInput(image, desk);
scaleInput(image, desk);
image.element.focus();

tapped(image.element, () => {
  if (layout === "tablet") desk.flip("swapped", false);
});

const parts = [image, readouts, header, notice, lost, view, plot, pass, announcer, player];
let before = performance.now();
const step = (now: number) => {
  pads.poll(now);
  desk.advance(Math.min(LONGEST_STEP, (now - before) / 1000));
  before = now;
  session.flush(now);
  reel.tick(now);
  session.draw(now);
  for (const part of parts) part.tick(now);
};
const loop = (now: number) => {
  requestAnimationFrame(loop);
  if (!view.software || now - before > SLOW_PACE) step(now);
};
requestAnimationFrame(loop);
// Where a processor draws the page, the next image waits for this one; a page nobody sees asks for none.
session.arrived.on(() => {
  if (view.software && !document.hidden) step(performance.now());
});

link.open();
