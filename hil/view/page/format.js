// Numbers as a person reads them: sensible digits, and no minus before a zero.

export function number(value, digits) {
  if (value == null || !Number.isFinite(value)) return "–";
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

export const metres = value => number(value, Math.abs(value) < 100 ? 1 : 0);  // a coordinate
export const bearing = degrees => degrees == null ? "–" : String(Math.round(((degrees % 360) + 360) % 360) % 360).padStart(3, "0");
export const clock = seconds => {
  const s = Math.max(0, Math.floor(seconds)), two = n => String(n).padStart(2, "0");
  return `${two(Math.floor(s / 3600))}:${two(Math.floor(s / 60) % 60)}:${two(s % 60)}`;
};
