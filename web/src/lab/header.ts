/** The lab's name, its results, and what is set at all stations at once. */

import { h, write } from "../dom";
import { logo } from "../icons";
import { exerciseChoice } from "./exerciseChoice";
import type { Lab } from "./lab";
import { lockButton } from "./lockButton";

export function labHeader(lab: Lab): HTMLElement {
  const course = h("b", {});
  const results = h("span", { class: "database" });
  const problem = h("p", { class: "problem", role: "status" });
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
    exerciseChoice(lab, "All stations", true),
    lockButton(lab, "Lock guides", "guides", true),
    lockButton(lab, "Lock models", "models", true),
    lockButton(lab, "Freeze all", "hands", true),
    h("a", { class: "button", href: table.href, download: "attempts.csv" }, "Export"),
  );
}
