// What lies over the picture, in small canvases: each is drawn again only when what it shows has changed, and moved by
// the browser. One canvas of the size of the screen would cost more time than the scene where no graphics card helps.

export class Parts {
  constructor(box) { this.box = box; this.parts = new Map(); }

  // Show with its origin at x, y of the picture, from left, top to right, bottom around it, what `draw(pen, ...values)` draws.
  put(name, [x, y], [left, top, right, bottom], draw, ...values) {
    const ratio = Math.min(devicePixelRatio || 1, 2), width = Math.ceil(right - left), height = Math.ceil(bottom - top);
    const key = JSON.stringify([left, top, width, height, ratio, values], (_, value) => typeof value === "number" ? Math.round(value * 100) / 100 : value);
    let part = this.parts.get(name);
    if (!part) {
      part = {canvas: document.createElement("canvas")};
      this.parts.set(name, part);
      this.box.append(part.canvas);
    }
    part.isPut = true;
    if (part.key !== key) {
      Object.assign(part, {key, width, height});
      part.canvas.width = width * ratio; part.canvas.height = height * ratio;
      Object.assign(part.canvas.style, {width: `${width}px`, height: `${height}px`});
      const pen = part.canvas.getContext("2d");
      pen.setTransform(ratio, 0, 0, ratio, -left * ratio, -top * ratio);
      draw(pen, ...values);
    }
    const place = `translate(${Math.round(x + left)}px, ${Math.round(y + top)}px)`;
    if (part.place !== place) {
      Object.assign(part, {place, x: Math.round(x + left), y: Math.round(y + top)});
      part.canvas.style.transform = place;
    }
  }

  // Remove what was not put since the last call.
  sweep() {
    for (const [name, part] of this.parts) {
      if (!part.isPut) { part.canvas.remove(); this.parts.delete(name); }
      part.isPut = false;
    }
  }

  drawOn(pen) {
    for (const {canvas, x, y, width, height} of this.parts.values()) pen.drawImage(canvas, x, y, width, height);
  }
}
