// Everything on the page that is text: figures, boards, controls, counters, events. Elements are made once and then only change their text, so that
// nothing jumps and the keyboard's place stays.
import { STAGES, WAIT } from "/chart.js";

const WORDS = {
  loading: ["LOADING", "warn"], joining: ["JOINING", "warn"], drawing: ["DRAWING", "good"], late: ["LATE", "warn"], leaving: ["LEAVING", "warn"],
  out: ["TAKEN OUT", "dim"], left: ["LEFT", "dim"], lost: ["LOST", "bad"], put_out: ["PUT OUT", "bad"],
};
const DOING = {
  stands_by: ["STANDS BY", "dim"], no_boards: ["NO BOARDS", "bad"], no_compositor: ["NO DISPLAY", "bad"], paused: ["PAUSED", "warn"], running: ["RUNNING", "good"], waiting: ["WAITING", "warn"],
};
const SKIPPED = {
  culled: "subobjects out of view", small: "objects too small", faded: "subobjects faded out", occluded: "hidden: triangles, pixels",
  backface: "triangles from behind", tiles_opaque: "tiles without translucency", pixels_single: "pixels shaded once",
  tiles_unchanged: "tiles not sent again", frames_unchanged: "board frames unchanged", frames_idle: "frames not opened", meshes_cached: "meshes kept by boards",
};
/** What boards draw. */
const DEBUGS = { depth: "depth complexity", levels: "levels of detail", skips: "skipped work" };
const TONES = { lost: "bad", "put out": "bad", refused: "warn", incomplete: "bad", substituted: "warn", draws: "good", whole: "good", control: "warn" };

const number = (value, digits = 0) => Number(value).toLocaleString("en", { minimumFractionDigits: digits, maximumFractionDigits: digits });
/** Three figures and a factor of a thousand, as instruments write. */
function short(value) {
  const [unit, factor] = value >= 1e12 ? [" T", 1e12] : value >= 1e9 ? [" G", 1e9] : value >= 1e6 ? [" M", 1e6] : value >= 1e4 ? [" k", 1e3] : ["", 1];
  const scaled = value / factor;
  return number(scaled, factor === 1 ? (Number.isInteger(scaled) || scaled >= 100 ? 0 : 1) : scaled >= 100 ? 0 : scaled >= 10 ? 1 : 2) + unit;
}
const bytes = value => `${short(value)}B`.replace(/(\d)B$/, "$1 B");
const mib = value => number(value / 1048576, value < 104857600 ? 1 : 0);
function clock(seconds) {
  const whole = Math.floor(seconds), two = n => String(n).padStart(2, "0");
  return `${two(Math.floor(whole / 3600))}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
}
function set(element, text) { if (element.textContent !== text) element.textContent = text; }
function tone(element, value) { if (element.dataset.tone !== value) element.dataset.tone = value; }
function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

/** Whether this manager leads, and who else could. */
function leadText({ lead, time_s }) {
  const term = lead.term ? `, term ${number(lead.term)}` : "";
  if (!lead.leads) return `stands by for ${lead.of} for ${clock(Math.max(0, time_s - lead.since_s))}${lead.other === null ? ", which doesn't answer" : ""}`;
  return lead.other === null ? `leads${term}; no stand-by` : `leads${term}; stand-by at ${lead.other} for ${clock(time_s - lead.other_since_s)}`;
}

export class Panels {
  constructor(document, rig) {
    this.$ = id => document.getElementById(id);
    this.rig = rig;
    this.controls = "none";
    this.boards = new Map();
    this.rows = new Map();
    this.minute = [];
    this.lastState = null;
    this.eventsOf = "";
    this.$("pause").addEventListener("click", () => rig.ask({ do: this.lastState?.is_paused ? "resume" : "pause" }));
    this.$("step").addEventListener("click", () => rig.ask({ do: "step" }));
    this.$("sharing").addEventListener("submit", async event => {
      event.preventDefault();
      const [now] = this.lastState?.views ?? [];
      const [mode, samples] = [this.$("mode").value, this.$("samples").value];
      if (mode !== now?.mode && !await rig.ask({ do: "mode", mode })) return;
      if (samples !== now?.samples) await rig.ask({ do: "samples", samples });
      this.chosen = false;
    });
    for (const id of ["mode", "samples"]) this.$(id).addEventListener("change", () => { this.chosen = true; this.refreshApply(); });
    for (const button of this.$("debugs").children) button.addEventListener("click", () => rig.ask({ do: "debug", picture: button.dataset.picture }));
    this.$("unlock").addEventListener("submit", event => {
      event.preventDefault();
      if (this.$("token").value) rig.unlock(this.$("token").value);
      this.$("token").value = "";
    });
  }

  get mayControl() {
    if (this.lastState && !this.lastState.lead.leads) return false;
    return this.controls === "open" || (this.controls === "token" && this.rig.hasToken());
  }

  onHello(hello) { this.controls = hello.controls; this.onToken(this.rig.hasToken()); }

  onToken(has) {
    this.$("unlock").hidden = this.controls !== "token" || has;
    set(this.$("control-note"), this.controls === "open" ? "open to this machine" : this.controls === "none"
      ? "read-only: start the manager with --console-token" : has ? "unlocked" : "locked: give the token");
    if (this.lastState) this.refreshControls(this.lastState);
  }

  onHistory(samples) { this.minute = samples.slice(); }

  say(text, isError = false) {
    set(this.$("said"), text.charAt(0).toUpperCase() + text.slice(1));
    tone(this.$("said"), isError ? "bad" : "dim");
  }

  announce(text) { set(this.$("announce"), text); }

  onSilence(word, why) {
    set(this.$("doing"), word);
    tone(this.$("doing"), "bad");
    document.body.classList.add("silent");
    this.announce(`${word}: ${why}`);
    this.wasSilent = true;
  }

  onState(state, sample) {
    document.body.classList.remove("silent");
    if (this.wasSilent) { this.announce("Contact with the rig again"); this.wasSilent = false; }
    this.minute.push(sample);
    if (this.minute.length > 240) this.minute.shift();
    const [word, color] = DOING[state.doing];
    set(this.$("doing"), word);
    tone(this.$("doing"), color);
    set(this.$("frame"), state.frame === null ? "–" : number(state.frame));
    set(this.$("clock"), clock(state.time_s));
    set(this.$("timing"), state.rate_hz === null ? "lock-step" : `real time, ${number(state.rate_hz, 1)} Hz`);
    set(this.$("epoch"), `${number(state.epoch)}`);
    set(this.$("lead"), leadText(state));
    this.debug(state.debug);
    this.figures(state);
    this.onBoards(state);
    this.refreshControls(state);
    this.stages();
    this.counters(state);
    this.events(state.events);
    this.lastState = state;
  }

  /** The debug picture that boards draw, if they do, and what its colours mean. */
  debug({ picture, legend }) {
    if (this.debugOf === picture) return;
    this.debugOf = picture;
    const name = DEBUGS[picture], note = name ? `Boards draw ${name}: displays show it too` : "";
    set(this.$("debug-note"), note);
    if (note) this.announce(note);
    const list = this.$("debug-legend");
    list.hidden = !legend.length;
    list.replaceChildren(...legend.map(({ color, mark, means }) => {
      const swatch = make("i", { ariaHidden: "true" });
      swatch.dataset.mark = mark;
      swatch.style.backgroundColor = `rgb(${color.join(" ")})`;
      return make("li", {}, swatch, means);
    }));
  }

  figures(state) {
    const recent = this.minute.slice(-5), span = recent.length > 1 ? recent.at(-1).time_s - recent[0].time_s : 0;
    const flown = recent.filter(s => s.frames);
    const mean = read => flown.length ? flown.reduce((sum, s) => sum + read(s) * s.frames, 0) / flown.reduce((sum, s) => sum + s.frames, 0) : null;
    const before = this.before?.find(([time]) => state.time_s - time < 1.6);
    const rate = before && state.time_s > before[0] ? (state.totals.frames - before[1]) / (state.time_s - before[0]) : span ? 0 : null;
    this.before = (this.before ?? []).filter(([time]) => state.time_s - time < 1.6).concat([[state.time_s, state.totals.frames]]);
    const show = (id, value, digits, color = "") => {
      set(this.$(id), value === null ? "–" : number(value, value >= 1000 ? 0 : digits));
      tone(this.$(id), color);
    };
    const nominal = state.rate_hz === null ? null : state.rate_hz / state.divider;
    show("f-rate", rate, 1, nominal !== null && (state.divider > 1 || rate < nominal * .9) && state.doing === "running" ? "warn" : "");
    set(this.$("f-rate-of"), nominal === null ? "as poses come" : state.divider > 1
      ? `of ${number(nominal, 1)} Hz, halved from ${number(state.rate_hz, 1)}${state.resolution_divider > 1 ? `; 1 pixel for ${state.resolution_divider ** 2}` : ""}` : `of ${number(nominal, 1)} Hz`);
    const frame = mean(s => s.frame_ms);
    show("f-frame", frame, 1, state.deadline_ms !== null && frame > state.deadline_ms ? "bad" : "");
    set(this.$("f-frame-of"), state.deadline_ms === null ? "no deadline" : `deadline ${number(state.deadline_ms, 1)} ms`);
    const timed = flown.filter(s => s.latency_ms !== null);
    const latency = timed.length ? timed.reduce((sum, s) => sum + s.latency_ms, 0) / timed.length : null;
    show("f-latency", latency, 1);
    const worst = Math.max(...this.minute.map(s => s.frame_max_ms));
    set(this.$("f-latency-of"), latency === null ? "no packets from a host" : `longest frame ${number(worst, 1)} ms`);
    const late = this.minute.reduce((sum, s) => sum + s.late, 0);
    show("f-late", late, 0, late ? "warn" : "");
    set(this.$("f-late-of"), `${number(state.totals.late_frames)} of ${number(state.totals.frames)} in all`);
  }

  onBoards(state) {
    const drawing = state.boards.filter(board => board.state === "drawing").length;
    set(this.$("chain-note"), `${drawing} of ${state.boards.length} drawing ${state.views.length} view${state.views.length === 1 ? "" : "s"}`);
    const present = new Set();
    for (const board of state.boards) {
      // A board that comes back takes the place that its name had.
      const slot = present.has(board.name) ? `${board.name} #${board.key}` : board.name;
      present.add(slot);
      if (!this.boards.has(slot)) this.boards.set(slot, this.makeBoard());
      this.fillBoard(this.boards.get(slot), board);
    }
    for (const [slot, card] of this.boards) {
      if (!present.has(slot)) { card.root.remove(); this.boards.delete(slot); }
    }
  }

  makeBoard() {
    const part = className => make("span", { className });
    const card = { id: part("id"), word: part("word"), name: part("name"), bar: make("i"), note: part("note"), values: {} };
    const entry = (key, label, unit) => {
      card.values[key] = make("span", { textContent: "–" });
      return make("div", {}, make("dt", { textContent: label }), make("dd", {}, card.values[key], " ", make("span", { className: "unit", textContent: unit })));
    };
    const values = make("dl", {}, entry("share", "Share", "%"), entry("load", "Load", "%"), entry("frame", "Frame", "ms"));
    card.button = make("button", { type: "button" });
    card.button.addEventListener("click", () => this.takeOrPut(card.board));
    const meter = make("div", { className: "meter", ariaHidden: "true" }, card.bar);
    const top = make("div", { className: "top" }, card.id, card.word);
    const who = make("div", { className: "who" }, card.name, card.note);
    card.root = make("li", {}, top, values, meter, make("div", { className: "foot" }, who, card.button));
    this.$("boards").append(card.root);
    return card;
  }

  fillBoard(card, board) {
    const [word, color] = WORDS[board.state];
    if (card.board && card.board.state !== board.state) this.announce(`Board ${board.name}: ${word.toLowerCase()}${board.why ? `, ${board.why}` : ""}`);
    card.board = board;
    tone(card.root, color);
    set(card.id, board.id === null ? "–" : String(board.id));
    card.id.title = board.id === null ? "not in the row" : `place ${board.id} in the row, from the left`;
    set(card.word, word);
    set(card.name, board.name);
    card.name.title = `board ${board.name}, key ${board.key}`;
    const show = (key, value, digits) => set(card.values[key], value === null ? "–" : number(value, digits));
    show("share", board.id === null ? null : board.share_percent, 1);
    show("load", board.load_percent, 0);
    show("frame", board.frame_ms, 1);
    card.bar.style.transform = `scaleX(${Math.min((board.load_percent ?? 0) / 100, 1)})`;
    const memory = board.memory_held_bytes === null ? "" : `${mib(board.memory_held_bytes)} of ${mib(board.memory_limit_bytes)} MiB`;
    set(card.note, board.why || memory);
    card.note.title = board.why || (memory && `memory for meshes and textures: ${memory}`);
    const isOut = board.state === "out", isGone = ["left", "lost", "put_out"].includes(board.state);
    card.button.hidden = isGone;
    card.button.disabled = !this.mayControl || board.state === "leaving";
    set(card.button, isOut ? "Put back" : "Take out");
    card.button.setAttribute("aria-label", isOut ? `Put board ${board.name} back` : `Take board ${board.name} out`);
  }

  takeOrPut(board) {
    if (board.state === "out") { this.rig.ask({ do: "put_back", board: board.key }); return; }
    const dialog = this.$("confirm");
    set(this.$("confirm-h"), `Take board ${board.name} out?`);
    set(this.$("confirm-text"), `The others draw its ${number(board.share_percent, 1)} % of the picture from then on. No frame is late for it, but each may take longer.`);
    dialog.addEventListener("close", () => {
      if (dialog.returnValue === "yes") this.rig.ask({ do: "take_out", board: board.key });
    }, { once: true });
    dialog.returnValue = "no";
    dialog.showModal();
  }

  refreshControls(state) {
    this.lastState = state;
    const may = this.mayControl, pause = this.$("pause");
    for (const button of this.$("debugs").children) {
      button.disabled = !may;
      button.setAttribute("aria-pressed", String(button.dataset.picture === state.debug.picture));
    }
    pause.disabled = !may;
    pause.setAttribute("aria-pressed", String(state.is_paused));
    set(pause, state.is_paused ? "Resume" : "Pause");
    this.$("step").disabled = !may || !state.is_paused;
    const [view] = state.views;
    for (const [id, value] of [["mode", view?.mode], ["samples", view?.samples]]) {
      this.$(id).disabled = !may;
      if (!this.chosen && value !== undefined && this.$(id).value !== value) this.$(id).value = value;
    }
    this.refreshApply(state);
  }

  refreshApply(state = this.lastState) {
    const [view] = state?.views ?? [];
    const isSame = this.$("mode").value === view?.mode && this.$("samples").value === view?.samples;
    if (isSame) this.chosen = false;
    this.$("apply").disabled = !this.mayControl || isSame;
  }

  /** A row of a table, made the first time. */
  row(table, name, color) {
    const key = `${table}/${name}`;
    if (!this.rows.has(key)) {
      const head = make("th", { scope: "row" });
      if (color) { const swatch = make("i", { ariaHidden: "true" }); swatch.style.background = color; head.append(swatch); }
      head.append(name);
      const cells = [make("td"), make("td")];
      if (table === "detail") cells.pop();
      this.$(table).querySelector("tbody").append(make("tr", {}, head, ...cells));
      this.rows.set(key, cells);
    }
    return this.rows.get(key);
  }

  stages() {
    const flown = this.minute.filter(sample => sample.frames), recent = this.minute.slice(-4).filter(sample => sample.frames);
    const mean = (samples, stage) => samples.length ? samples.reduce((sum, s) => sum + s[stage] * s.frames, 0) / samples.reduce((sum, s) => sum + s.frames, 0) : null;
    for (const [stage, color] of [WAIT, ...STAGES]) {
      const [now, minute] = this.row("stages", stage, color);
      const show = value => value === null ? "–" : number(value, 2);
      set(now, show(mean(recent, stage)));
      set(minute, show(mean(flown, stage)));
    }
  }

  counters(state) {
    // Over the last two seconds: short enough to follow, long enough to read.
    this.past = (this.past ?? []).filter(past => state.time_s - past.time_s < 2.3).concat(state);
    const past = this.past[0], frames = state.totals.frames - past.totals.frames;
    const per = (now, then) => frames > 0 ? short((now - then) / frames) : "–";
    for (const [name, label] of Object.entries(SKIPPED)) {
      const [each, all] = this.row("skipped", label);
      set(each, per(state.totals.skipped[name], past.totals.skipped[name]));
      set(all, short(state.totals.skipped[name]));
    }
    const show = (label, text) => set(this.row("detail", label)[0], text);
    const { streaming, dropped } = state.totals;
    show("K, display factor", number(state.display_factor, 1));
    show("models between levels", `${number(state.models_in_transition)} of ${number(state.models)}`);
    show("triangles a frame", per(state.totals.triangles, past.totals.triangles));
    show("translucent fragments a frame", per(state.totals.fragments, past.totals.fragments));
    show("to boards a frame", frames > 0 ? bytes((state.totals.bytes_to_boards - past.totals.bytes_to_boards) / frames) : "–");
    show("tiles from boards a frame", frames > 0 ? bytes((state.totals.bytes_from_boards - past.totals.bytes_from_boards) / frames) : "–");
    show("scene", `${mib(state.scene_bytes)} MiB`);
    show("pieces sent, given up", `${short(streaming.pieces)}, ${short(streaming.evicted)}`);
    show("models shown otherwise, left out", `${short(streaming.substitutions)}, ${short(streaming.omitted)}`);
    show("views that repeated", short(state.totals.repeated_views));
    show("dropped: packets, links, boards", `${short(dropped.pose_packets + dropped.stale_poses)}, ${short(dropped.connections)}, ${short(dropped.boards)}`);
  }

  events(events) {
    const text = JSON.stringify(events.at(-1)) + events.length;
    if (text === this.eventsOf) return;
    this.eventsOf = text;
    this.$("events").replaceChildren(...events.slice().reverse().map(({ time_s, frame, event, detail }) => {
      const line = make("li", {}, make("time", { textContent: `${number(time_s, 2)} s`, title: `frame ${frame}` }), make("b", { textContent: event }),
        make("span", { textContent: detail }));
      line.dataset.tone = TONES[event] ?? "";
      return line;
    }));
  }
}
