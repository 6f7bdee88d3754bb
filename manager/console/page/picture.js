// The picture: all views or one of them, and the tiles by owner over it.

/** Colours that are told apart, also by those who see few: hue by golden angle, lightness by turns. */
export function boardColor(id) {
  return `hsl(${(210 + id * 137.508) % 360} 75% ${id % 2 ? 70 : 52}%)`;
}

const $ = (document, id) => document.getElementById(id);

export class Picture {
  constructor(document) {
    this.canvas = $(document, "picture");
    this.context = this.canvas.getContext("2d");
    this.screen = $(document, "screen");
    this.choices = $(document, "views");
    this.overlay = $(document, "owners");
    this.legend = $(document, "legend");
    this.rate = $(document, "picture-rate");
    this.view = null;
    this.layout = null;
    this.image = null;
    this.frame = null;
    this.owners = null;
    this.times = [];
    this.said = 0;
    this.overlay.addEventListener("change", () => { this.legend.hidden = !this.overlay.checked; this.refreshOwners(); this.draw(); });
  }

  /** A message: the frame's number and a JPEG. */
  async show(bytes) {
    const frame = new DataView(bytes).getBigUint64(0, true);
    let image;
    try {
      image = await createImageBitmap(new Blob([new Uint8Array(bytes, 8)], { type: "image/jpeg" }));
    } catch { return; }
    this.image?.close();
    [this.image, this.frame] = [image, frame];
    const now = performance.now();
    this.times = this.times.filter(at => now - at < 3000).concat(now);
    this.draw();
  }

  onState(state) {
    const isFirst = this.layout === null;
    this.layout = state;
    this.shape();
    // A picture may have come before it was known what it is of.
    if (isFirst) this.draw();
    const count = state.views.length;
    if (this.choices.children.length !== count + 1) this.offerViews(count);
    const recent = this.times.filter(at => performance.now() - at < 3000).length / 3;
    this.rate.textContent = this.frame === null ? "no picture yet"
      : `frame ${this.frame.toLocaleString("en")} · ${recent.toFixed(1)} pictures/s`;
    if (performance.now() - this.said > 5000) this.describe();
    this.refreshOwners();
  }

  offerViews(count) {
    const button = (text, view) => {
      const choice = document.createElement("button");
      choice.type = "button";
      choice.textContent = text;
      choice.setAttribute("aria-pressed", String(this.view === view));
      choice.addEventListener("click", () => {
        this.view = view;
        for (const other of this.choices.children) other.setAttribute("aria-pressed", String(other === choice));
        this.draw();
        this.describe();
      });
      return choice;
    };
    if (this.view !== null && this.view >= count) this.view = null;
    const views = Array.from({ length: count }, (_, k) => button(`View ${k}`, k));
    this.choices.replaceChildren(button("All views", null), ...views);
  }

  /** What is cut out of the stitched picture, its pixels. */
  part() {
    const { size: [width, height], views } = this.layout;
    return this.view === null || !views[this.view] ? { x: 0, y: 0, width, height } : views[this.view];
  }

  /** The room for the picture has its shape before there is one, so that nothing moves when it comes. */
  shape() {
    const { width, height } = this.part(), ratio = `${width} / ${height}`;
    if (!width || !height || this.shaped === ratio) return;
    this.shaped = ratio;
    this.screen.style.aspectRatio = ratio;
  }

  draw() {
    if (!this.image || !this.layout?.size[0]) return;
    const part = this.part(), scale = this.image.width / this.layout.size[0];
    const [width, height] = [Math.max(1, Math.round(part.width * scale)), Math.max(1, Math.round(part.height * scale))];
    if (this.canvas.width !== width || this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [width, height];
    this.shape();
    this.context.drawImage(this.image, part.x * scale, part.y * scale, part.width * scale, part.height * scale, 0, 0, width, height);
    if (this.overlay.checked && this.owners) this.drawOwners(part, scale);
  }

  drawOwners(part, scale) {
    const { context, owners } = this;
    context.save();
    context.scale(scale, scale);
    context.translate(-part.x, -part.y);
    // Tiles are of the views that boards draw.
    const side = owners.tile * this.layout.resolution_divider;
    this.layout.views.forEach((view, k) => {
      const tiles = owners.views[k];
      if (!tiles || (this.view !== null && this.view !== k)) return;
      tiles.owners.forEach((owner, i) => {
        const x = (i % tiles.columns) * side, y = Math.floor(i / tiles.columns) * side;
        const width = Math.min(side, view.width - x), height = Math.min(side, view.height - y);
        context.globalAlpha = .38;
        context.fillStyle = boardColor(owner);
        context.fillRect(view.x + x, view.y + y, width, height);
        context.globalAlpha = .55;
        context.strokeStyle = "#000";
        context.lineWidth = 1 / scale;
        context.strokeRect(view.x + x, view.y + y, width, height);
      });
    });
    context.restore();
  }

  /** The tiles' owners change with the wiring and the views only. */
  async refreshOwners() {
    const { layout, owners } = this;
    if (!this.overlay.checked || !layout || this.asking) return;
    this.writeLegend(layout);
    if (owners && owners.epoch === this.ownersOf?.epoch && this.ownersOf.at === `${layout.epoch}/${layout.views_revision}`) return;
    this.asking = true;
    try {
      const at = `${layout.epoch}/${layout.views_revision}`;
      this.owners = await (await fetch("/api/v1/owners")).json();
      // Until the newest wiring is in effect, the answer is still the last one's.
      this.ownersOf = { epoch: this.owners.epoch, at: this.owners.epoch === layout.epoch ? at : "" };
      this.draw();
    } catch { /* the header says that there is no contact */ }
    this.asking = false;
  }

  writeLegend(state) {
    const drawing = state.boards.filter(board => board.id !== null);
    const text = JSON.stringify(drawing.map(board => [board.id, board.name]));
    if (this.legendOf === text) return;
    this.legendOf = text;
    this.legend.replaceChildren(...drawing.map(board => {
      const entry = document.createElement("li"), swatch = document.createElement("i");
      swatch.style.background = boardColor(board.id);
      entry.append(swatch, `${board.id}: board ${board.name}`);
      return entry;
    }));
  }

  describe() {
    this.said = performance.now();
    const what = this.view === null ? "All views side by side" : `View ${this.view}`;
    const over = this.overlay.checked ? ", tiles coloured by the board that drew them" : "";
    this.canvas.setAttribute("aria-label", this.frame === null ? "No picture yet" : `${what}, frame ${this.frame}${over}`);
  }
}
