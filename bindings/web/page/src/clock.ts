// Display of times: seconds since the first frame, UTC or local time.

import { seconds } from "./dom";
import type { Overview } from "./protocol";

export type Clock = "seconds" | "UTC" | "local";

const NEXT: Record<Clock, Clock> = { seconds: "UTC", UTC: "local", local: "seconds" };

/** The display after this one; a capture without dates has only seconds. */
export function nextClock(clock: Clock, overview: Overview): Clock {
  return overview.start === null ? "seconds" : NEXT[clock];
}

/** A time in s since the first frame, as the clock shows it: `7.204`, or `2023-11-14 22:13:27.204`. */
export function moment(time: number | null | undefined, clock: Clock, overview: Overview, digits = 3): string {
  if (clock === "seconds" || overview.zero === null || time === null || time === undefined) return seconds(time, digits);
  // A float of seconds since 1970 has steps of 0.2 µs.
  const date = new Date(Math.floor(Math.round((Number(overview.zero) + time) * 1e6) / 1e3));
  if (Number.isNaN(date.getTime())) return seconds(time, digits);
  if (clock === "UTC") return date.toISOString().replace("T", " ").replace("Z", "");
  const two = (value: number) => String(value).padStart(2, "0");
  const day = `${date.getFullYear()}-${two(date.getMonth() + 1)}-${two(date.getDate())}`;
  return `${day} ${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}.${String(date.getMilliseconds()).padStart(3, "0")}`;
}

/** The same for a row: without the year, and without the day if the capture has only one. */
export function shortMoment(time: number | null | undefined, clock: Clock, overview: Overview, digits = 3): string {
  const text = moment(time, clock, overview, digits);
  if (clock === "seconds" || !text.includes(" ")) return text;
  const day = (at: number) => moment(at, clock, overview).slice(0, 10);
  return day(0) === day(overview.duration ?? 0) ? text.slice(11) : text.slice(5);
}
