/** Cividis, from 22 % up: dark blue would vanish on the dark ground. */

const FROM = 0.22;

/** (r, g, b) in 0..1 at equal steps of the map. */
const STOPS: readonly (readonly [number, number, number])[] = [
  [0.0, 0.1354, 0.3048], [0.0, 0.1944, 0.4411], [0.2117, 0.2714, 0.4234], [0.3158, 0.3457, 0.4251],
  [0.4024, 0.4202, 0.4388], [0.4881, 0.4962, 0.4711], [0.5798, 0.5747, 0.4743], [0.6784, 0.658, 0.4569],
  [0.7831, 0.7467, 0.4188], [0.8946, 0.8407, 0.3522], [0.9957, 0.9093, 0.2178],
];

/** Colour of a share from 0 to 1 into `out` at `at`. */
export function cividis(share: number, out: Float32Array | number[], at: number): void {
  const place = (FROM + (1 - FROM) * Math.min(1, Math.max(0, share))) * (STOPS.length - 1);
  const k = Math.min(STOPS.length - 2, Math.floor(place));
  const part = place - k;
  for (let c = 0; c < 3; c += 1) out[at + c] = STOPS[k][c] + part * (STOPS[k + 1][c] - STOPS[k][c]);
}

/** A round number at or above a length: 1, 2 or 5 of a power of ten. */
export function roundUp(mm: number): number {
  if (mm <= 0) return 1;
  const ten = 10 ** Math.floor(Math.log10(mm));
  for (const k of [1, 2, 5, 10]) if (mm <= k * ten * (1 + 1e-9)) return k * ten;
  return 10 * ten;
}
