// Numbers as a person reads them: sensible digits, and no minus before a zero. Texts that are written when they change.

const shown = {};

export function isNew(place, value) {  // whether a place of the page shows another value than the last one asked for
  const key = JSON.stringify(value);
  return shown[place] !== key && Boolean(shown[place] = key);
}

export function write(id, text) { if (isNew(id, text)) document.getElementById(id).textContent = text; }

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
