// Plays a log: rows over time, scrubbed, at any speed.
export class Player {
  constructor(get, show) {
    this.get = get;
    this.show = show;
    this.rows = [];
    this.time = 0;
    this.playing = false;
    this.element = Object.fromEntries(['play', 'scrub', 'time', 'rate', 'download'].map((id) => [id, document.getElementById(id)]));
    this.element.play.addEventListener('click', () => this.toggle());
    this.element.scrub.addEventListener('input', () => {
      this.pause();
      this.seek(Number(this.element.scrub.value) * this.seconds);
    });
    addEventListener('keydown', (event) => {
      if (document.body.dataset.mode !== 'clip' || ['SELECT', 'BUTTON'].includes(event.target.tagName)) return;
      if (event.code === 'Space') {
        this.toggle();
        event.preventDefault();
      }
    });
  }

  get seconds() {
    return this.rows.length ? this.rows[this.rows.length - 1][0] : 0;
  }

  // Loads log `index`, whose rows have `width` numbers.
  async open(index, width) {
    const numbers = new Float32Array(await (await this.get(`clips/${index}`)).arrayBuffer());
    this.rows = Array.from({ length: numbers.length / width }, (_, i) => numbers.subarray(i * width, (i + 1) * width));
    this.element.download.href = this.get.address(`clips/${index}/log`);
    this.seek(0);
    this.#play(true);
  }

  toggle() {
    if (!this.playing && this.time >= this.seconds) this.seek(0);
    this.#play(!this.playing);
  }

  pause() {
    this.#play(false);
  }

  #play(on) {
    this.playing = on;
    this.element.play.textContent = on ? 'Pause' : 'Play';
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.seconds);
    this.element.scrub.value = this.seconds ? this.time / this.seconds : 0;
    this.element.time.textContent = `${this.time.toFixed(2)} / ${this.seconds.toFixed(2)} s`;
    this.element.scrub.setAttribute('aria-valuetext', `${this.time.toFixed(2)} s`);
    if (this.rows.length) this.show(this.row);
  }

  get row() {
    let [low, high] = [0, this.rows.length - 1];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.rows[middle][0] <= this.time + 1e-6) low = middle;
      else high = middle - 1;
    }
    return this.rows[low];
  }

  advance(elapsed) {
    if (!this.playing) return;
    this.seek(this.time + elapsed * Number(this.element.rate.value));
    if (this.time >= this.seconds) this.pause();
  }
}
