/** What tissue does in time and under the probe: five switches, what each turns on and off, and why one is not to be had. Pure. */

import type { Scene, TissueSettings } from "./protocol";

export type TissueSwitch = "breathe" | "hold" | "remember" | "relax" | "press";

export const SWITCHES: readonly { id: TissueSwitch; name: string; note: string }[] = [
  { id: "breathe", name: "Breathing", note: "The diaphragm carries the organs along" },
  { id: "hold", name: "Hold the breath", note: "It stands still, and drifts a little" },
  { id: "remember", name: "Needle remembers", note: "It sticks and slips; skin and capsules have to be pierced" },
  { id: "relax", name: "Tissue relaxes", note: "The force of a needle that rests falls" },
  { id: "press", name: "Probe presses", note: "It dents the skin where it is" },
];

export const STILL: TissueSettings = { contact: "pose", relaxation: "none", breathing: "none", probe: "looks" };

export function isOn(tissue: TissueSettings, id: TissueSwitch): boolean {
  switch (id) {
    case "breathe":
      return tissue.breathing !== "none";
    case "hold":
      return tissue.breathing === "held";
    case "remember":
      return tissue.contact === "track";
    case "relax":
      return tissue.relaxation === "tissue";
    case "press":
      return tissue.probe === "presses";
  }
}

/** What is asked for once a switch is turned: only tissue in which needles leave tracks can relax. */
export function turned(tissue: TissueSettings, id: TissueSwitch): TissueSettings {
  const on = !isOn(tissue, id);
  switch (id) {
    case "breathe":
      return { ...tissue, breathing: on ? "free" : "none" };
    case "hold":
      return { ...tissue, breathing: on ? "held" : "free" };
    case "remember":
      return { ...tissue, contact: on ? "track" : "pose", relaxation: "none" };
    case "relax":
      return { ...tissue, contact: on ? "track" : tissue.contact, relaxation: on ? "tissue" : "none" };
    case "press":
      return { ...tissue, probe: on ? "presses" : "looks" };
  }
}

/** Why a switch does nothing in a scene and with a model; null where it does. */
export function unavailable(scene: Scene, model: string, tissue: TissueSettings, id: TissueSwitch): string | null {
  const known = scene.models.find((candidate) => candidate.id === model);
  if (!known?.time) return `${known?.name ?? model} knows no time`;
  if ((id === "breathe" || id === "hold") && !scene.breathes) return "This scene does not breathe";
  return id === "hold" && tissue.breathing === "none" ? "Nobody breathes" : null;
}

/** The force of the probe in words; nothing where it only looks. */
export const pressing = (newtons: number | null): string => (newtons === null ? "" : `Probe ${newtons.toFixed(1)} N`);

/** All of it in a word or two. */
export function inShort(scene: Scene, model: string, tissue: TissueSettings, excursion: number, probe: number | null = null): string {
  if (unavailable(scene, model, tissue, "remember")) return "No time";
  if (tissue.breathing !== "none" || excursion !== 0) return `${tissue.breathing === "held" ? "Held" : "Breath"} ${excursion.toFixed(0)} mm`;
  if (probe !== null) return pressing(probe);
  if (tissue.relaxation === "tissue") return "Relaxes";
  return tissue.contact === "track" ? "Remembers" : "Still";
}
