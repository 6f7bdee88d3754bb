// Time by stage as it went in the last minute: stacked from zero, where a frame opens, up to the picture; what the host's packet waited
// before is below. The dashed line is the deadline.

/** In the order of a frame. */
export const STAGES = [
  ["select", "#4f86c6"], ["stream", "#7aa6d8"], ["geometry", "#3f9e8f"], ["raster", "#62c1a4"], ["translucency", "#9a7fd1"],
  ["resolve", "#c08fd8"], ["transfer", "#d39a55"], ["links", "#6b7785"], ["stitch", "#e0c06a"],
];
export const WAIT = ["wait", "#3c4854"];

const SAMPLES = 240;
/** Ends of the scale, ms: the next of these that holds everything, so that it seldom changes. */
const SCALES = [5, 10, 20, 25, 40, 50, 100, 200, 250, 400, 500, 600, 800, 1000, 2000, 5000, 10000, 20000, 60000];
const MARGIN = { left: 58, right: 10, top: 10, bottom: 22 };

export class Chart {
  constructor(document) {
    this.canvas = document.getElementById("chart");
    this.samples = [];
    this.deadline = null;
    this.up = SCALES[2];
    this.shrink = 0;
    this.said = 0;
    new ResizeObserver(() => this.draw()).observe(this.canvas);
  }

  begin(history) { this.samples = history; this.draw(); }

  add(sample, deadline) {
    this.samples.push(sample);
    if (this.samples.length > SAMPLES) this.samples.shift();
    this.deadline = deadline;
    this.draw();
    if (performance.now() - this.said > 5000) this.describe();
  }

  scale() {
    const most = Math.max(...this.samples.map(s => Math.max(s.frame_max_ms, s.frame_ms + s.stitch)), (this.deadline ?? 0) * 1.15, 1);
    const fits = SCALES.find(end => end >= most) ?? most;
    // Up at once, down after ten quiet seconds.
    if (fits >= this.up) [this.up, this.shrink] = [fits, 0];
    else if (++this.shrink > 40) [this.up, this.shrink] = [fits, 0];
    const wait = Math.max(...this.samples.map(s => s.wait), 0);
    return { up: this.up, down: wait > 0.005 * this.up ? Math.min(Math.ceil(wait / this.up * 5) / 5, 1) * this.up : 0 };
  }

  draw() {
    const ratio = devicePixelRatio || 1, width = this.canvas.clientWidth, height = this.canvas.clientHeight;
    if (!width || !height) return;
    if (this.canvas.width !== Math.round(width * ratio) || this.canvas.height !== Math.round(height * ratio)) {
      [this.canvas.width, this.canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    }
    const g = this.canvas.getContext("2d");
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, width, height);
    const { up, down } = this.scale(), { left, right, top, bottom } = MARGIN;
    const plot = { w: width - left - right, h: height - top - bottom };
    const y = ms => top + plot.h * (up - ms) / (up + down);
    const x = k => left + plot.w * (k + SAMPLES - this.samples.length) / (SAMPLES - 1);
    g.font = "12px system-ui, 'DejaVu Sans', sans-serif";
    g.lineWidth = 1;
    g.textBaseline = "middle";
    g.textAlign = "right";
    const lines = [0, up / 4, up / 2, up * 3 / 4, up].concat(down > up / 8 ? [-down] : []);
    for (const ms of lines) {
      g.strokeStyle = ms === 0 ? "#5d6b79" : "#1d252d";
      g.beginPath(); g.moveTo(left, Math.round(y(ms)) + .5); g.lineTo(width - right, Math.round(y(ms)) + .5); g.stroke();
      g.fillStyle = "#9aa7b4";
      g.fillText(`${+ms.toPrecision(3)} ms`, left - 6, y(ms));
    }
    g.textBaseline = "alphabetic";
    for (const [seconds, align] of [[60, "left"], [45, "center"], [30, "center"], [15, "center"], [0, "right"]]) {
      g.textAlign = align;
      g.fillText(seconds ? `−${seconds} s` : "now", left + plot.w * (60 - seconds) / 60, height - 6);
    }
    this.stack(g, x, y);
    this.line(g, x, y);
    if (this.deadline !== null) {
      const at = Math.round(y(this.deadline)) + .5;
      g.strokeStyle = "#ff6257";
      g.setLineDash([6, 4]);
      g.beginPath(); g.moveTo(left, at); g.lineTo(width - right, at); g.stroke();
      g.setLineDash([]);
      g.textAlign = "left";
      const label = `deadline ${this.deadline.toFixed(1)} ms`;
      g.fillStyle = "#0f1418d8";
      g.fillRect(left + 3, at - 18, g.measureText(label).width + 8, 16);
      g.fillStyle = "#ff8a80";
      g.fillText(label, left + 7, at - 6);
    }
  }

  /** Runs of samples that have frames: where there were none for two seconds there is a gap. */
  runs() {
    const runs = [];
    this.samples.forEach((sample, k) => {
      if (!sample.frames) return;
      const last = runs.at(-1);
      if (last && k - last.at(-1) <= 8) last.push(k); else runs.push([k]);
    });
    return runs;
  }

  stack(g, x, y) {
    for (const run of this.runs()) {
      const floor = run.map(() => 0);
      const area = (color, lower, upper) => {
        g.fillStyle = color;
        g.beginPath();
        const half = run.length === 1 ? 1.5 : 0;
        run.forEach((k, i) => { g.lineTo(x(k) - half, y(lower[i])); if (half) g.lineTo(x(k) + half, y(lower[i])); });
        for (let i = run.length - 1; i >= 0; i--) { g.lineTo(x(run[i]) + half, y(upper[i])); if (half) g.lineTo(x(run[i]) - half, y(upper[i])); }
        g.fill();
      };
      for (const [stage, color] of STAGES) {
        const above = run.map((k, i) => floor[i] + this.samples[k][stage]);
        area(color, floor, above);
        above.forEach((value, i) => { floor[i] = value; });
      }
      area(WAIT[1], run.map(() => 0), run.map(k => -this.samples[k].wait));
    }
  }

  /** The longest frame of each sample. */
  line(g, x, y) {
    g.strokeStyle = "#e2e8ee";
    g.lineWidth = 1.25;
    for (const run of this.runs()) {
      g.beginPath();
      run.forEach(k => g.lineTo(x(k), y(Math.min(this.samples[k].frame_max_ms, this.up))));
      g.stroke();
    }
  }

  describe() {
    this.said = performance.now();
    const flown = this.samples.filter(sample => sample.frames);
    const last = flown.at(-1);
    const text = last
      ? `Time by stage over the last minute. Now a frame takes ${last.frame_ms.toFixed(1)} ms, ${this.deadline === null
        ? "without a deadline" : `of ${this.deadline.toFixed(1)} ms`}; the longest of the minute took ${Math.max(...flown.map(s => s.frame_max_ms)).toFixed(1)} ms. `
        + "The table below has each stage."
      : "No frames in the last minute";
    this.canvas.setAttribute("aria-label", text);
  }
}
