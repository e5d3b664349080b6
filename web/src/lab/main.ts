/** The trainer's page: stations, the one that is watched, and results. */

import { h } from "../dom";
import { stationCards } from "./cards";
import { labHeader } from "./header";
import { Lab } from "./lab";
import { LearningCurves } from "./learning";
import { SignIn } from "./signIn";
import { Standings } from "./standings";
import { Watched } from "./watched";
import "../styles/lab.css";

const lab = new Lab(location.href);
const watched = new Watched(lab);
const standings = new Standings(lab, () => curves.draw());
const curves = new LearningCurves(lab, () => standings.chosen);
const signIn = new SignIn(lab);

document.body.append(
  labHeader(lab),
  h("main", { class: "lab" }, h("div", { class: "overview" }, stationCards(lab), curves.element), h("div", { class: "attended" }, watched.element, standings.element)),
  signIn.element,
);
watched.image.use("compact");

const loop = (now: number) => {
  requestAnimationFrame(loop);
  watched.tick(now);
};
requestAnimationFrame(loop);

if (new URL(location.href).searchParams.get("trainer")) lab.link.open();
else signIn.show(true);
