/** The lab's name, its results, and what is set at all stations at once. */

import { h, write } from "../dom";
import { logo } from "../icons";
import { exerciseChoice } from "./exerciseChoice";
import type { Lab } from "./lab";

export function labHeader(lab: Lab): HTMLElement {
  const course = h("b", {});
  const results = h("span", { class: "database" });
  const problem = h("p", { class: "problem", role: "status" });
  const common = () => {
    const found = new Set(lab.stations.map(({ exercise_set }) => exercise_set));
    return found.size === 1 ? [...found][0] : null;
  };
  const lock = (what: "guides" | "models", label: string) => {
    const button = h("button", { type: "button", class: "button toggle", "aria-pressed": "false" }, label);
    button.addEventListener("click", () => lab.say({ type: "lock_station", station: null, what, on: button.getAttribute("aria-pressed") !== "true" }));
    lab.changed.on(({ stations }) => button.setAttribute("aria-pressed", String(stations.length > 0 && stations.every((one) => one[`${what}_locked`]))));
    return button;
  };
  const table = new URL("attempts.csv", location.href);
  table.search = new URL(location.href).search;
  lab.greeted.on((hello) => {
    document.title = `${hello.course} · Sonospline lab`;
    write(results, hello.results);
  });
  lab.changed.on(({ stations, waiting, problem: why }) => {
    const seated = stations.filter(({ participant }) => participant !== null).length;
    write(course, `${lab.hello?.course ?? ""} · ${seated} of ${stations.length} stations`);
    write(problem, waiting && why ? `${waiting} ${waiting === 1 ? "result waits" : "results wait"}: ${why}` : "");
  });
  return h(
    "header",
    { class: "header" },
    h("h1", {}, logo(), h("span", {}, "Sonospline")),
    h("span", { class: "tag" }, "Lab"),
    course,
    results,
    problem,
    h("span", { class: "space" }),
    exerciseChoice(lab, "All stations", () => null, common),
    lock("guides", "Lock guides"),
    lock("models", "Lock models"),
    h("a", { class: "button", href: table.href, download: "attempts.csv" }, "Export"),
  );
}
