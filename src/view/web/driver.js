// Drives the robot that walks live: keyboard, sticks, gamepad, conditions, pushes, recordings.
const PERIOD = 50; // ms between orders
const SHARE = 0.6; // of the trained velocity, by keys; all of it with Shift
const DEAD = 0.15; // of a gamepad's stick

const KEYS = {
  KeyW: [1, 0, 0], ArrowUp: [1, 0, 0], KeyS: [-1, 0, 0], ArrowDown: [-1, 0, 0], KeyA: [0, 1, 0], KeyD: [0, -1, 0],
  KeyQ: [0, 0, 1], ArrowLeft: [0, 0, 1], KeyE: [0, 0, -1], ArrowRight: [0, 0, -1],
};

// A stick on the screen; `wide` ones move sideways only. Its value is right and up, from -1 to 1.
class Stick {
  constructor(element) {
    this.value = [0, 0];
    this.element = element;
    this.wide = element.classList.contains('wide');
    element.addEventListener('pointerdown', (event) => {
      element.setPointerCapture(event.pointerId);
      this.#move(event);
    });
    element.addEventListener('pointermove', (event) => {
      if (element.hasPointerCapture(event.pointerId)) this.#move(event);
    });
    for (const end of ['pointerup', 'pointercancel', 'lostpointercapture']) {
      element.addEventListener(end, () => this.#set(0, 0));
    }
  }

  #move(event) {
    const box = this.element.getBoundingClientRect();
    const half = [(box.width - 44) / 2, (box.height - 44) / 2];
    let x = (event.clientX - box.left - box.width / 2) / half[0];
    let y = this.wide ? 0 : -(event.clientY - box.top - box.height / 2) / half[1];
    const length = Math.max(1, Math.hypot(x, y));
    this.#set(x / length, y / length);
  }

  #set(x, y) {
    this.value = [x, y];
    const { clientWidth: width, clientHeight: height } = this.element;
    this.element.firstElementChild.style.transform = `translate(${x * (width - 44) / 2}px, ${-y * (height - 44) / 2}px)`;
  }
}

export class Driver {
  // `onRow` gets each row, `onReport` each report of the robot's condition.
  constructor(address, stage, { onRow, onReport, onTrouble }) {
    Object.assign(this, { address, stage, onRow, onReport, onTrouble });
    this.keys = new Set();
    this.fast = false;
    this.walk = new Stick(document.getElementById('walk'));
    this.twist = new Stick(document.getElementById('twist'));
    this.strength = document.getElementById('strength');
    this.moving = false;
    this.#keyboard();
    this.#clicks();
    for (const name of ['friction', 'latency', 'payload']) {
      document.getElementById(name).addEventListener('input', ({ target }) => {
        this.send({ type: 'set', condition: name, value: Number(target.value) });
        label(target);
      });
    }
    this.strength.addEventListener('input', () => label(this.strength));
    document.getElementById('push').addEventListener('click', () => this.push());
    document.getElementById('stand').addEventListener('click', () => this.send({ type: 'stand' }));
    this.record = document.getElementById('record');
    this.record.addEventListener('click', () => {
      this.send({ type: 'record', on: this.record.getAttribute('aria-pressed') !== 'true' });
    });
    setInterval(() => this.#steer(), PERIOD);
    this.#connect();
  }

  #connect() {
    this.socket = new WebSocket(this.address);
    this.socket.binaryType = 'arraybuffer';
    this.socket.addEventListener('message', ({ data }) => {
      if (typeof data !== 'string') return this.onRow(new Float32Array(data));
      const message = JSON.parse(data);
      if (message.type === 'hello') this.#meet(message.limits);
      else if (message.type === 'report') this.#hear(message);
      else this.onTrouble(message.why);
    });
    this.socket.addEventListener('close', () => {
      this.onTrouble('not connected');
      setTimeout(() => this.#connect(), 1000);
    });
  }

  send(order) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(order));
  }

  #meet(limits) {
    this.limits = limits;
    for (const name of ['friction', 'latency', 'payload']) {
      const input = document.getElementById(name);
      Object.assign(input, { min: limits[name].lower, max: limits[name].upper, value: limits[name].start });
      label(input);
    }
    Object.assign(this.strength, { min: 0, max: Math.floor(limits.push), value: Math.round(limits.push / 3) });
    label(this.strength);
  }

  #hear(report) {
    if (!('mode' in report)) return;
    const recording = report.recording !== null;
    this.record.setAttribute('aria-pressed', recording);
    this.record.textContent = recording ? `Stop ${report.recording.toFixed(0)} s` : 'Record';
    for (const name of ['friction', 'latency', 'payload']) {
      const input = document.getElementById(name);
      if (document.activeElement !== input) {
        input.value = report[name];
        label(input);
      }
    }
    this.onReport(report);
  }

  #keyboard() {
    addEventListener('keydown', (event) => {
      if (document.body.dataset.mode !== 'live' || event.ctrlKey || event.metaKey || event.altKey) return;
      if (['SELECT', 'INPUT'].includes(event.target.tagName) && event.code.startsWith('Arrow')) return;
      this.fast = event.shiftKey;
      if (event.code === 'KeyR' && !event.repeat) this.send({ type: 'stand' });
      if (!(event.code in KEYS)) return;
      this.keys.add(event.code);
      event.preventDefault();
    });
    addEventListener('keyup', (event) => {
      this.fast = event.shiftKey;
      this.keys.delete(event.code);
    });
    addEventListener('blur', () => this.keys.clear());
  }

  // A click that is not a turn of the camera pushes the robot away from the viewer.
  #clicks() {
    let down = null;
    this.stage.canvas.addEventListener('pointerdown', (event) => { down = [event.clientX, event.clientY]; });
    this.stage.canvas.addEventListener('pointerup', ({ clientX: x, clientY: y }) => {
      const still = down && Math.hypot(x - down[0], y - down[1]) < 6;
      down = null;
      if (still && document.body.dataset.mode === 'live' && this.stage.isRobotAt(x, y)) this.push();
    });
  }

  push() {
    const { x, y } = this.stage.ahead();
    const force = Number(this.strength.value);
    this.send({ type: 'push', force: [force * x, force * y] });
  }

  // Forward, left and turning to the left, each from -1 to 1, of whatever is moved.
  #wish() {
    const wish = [this.walk.value[1], -this.walk.value[0], -this.twist.value[0]];
    for (const key of this.keys) KEYS[key].forEach((x, axis) => { wish[axis] += x * (this.fast ? 1 : SHARE); });
    for (const pad of navigator.getGamepads?.() ?? []) {
      if (!pad?.connected) continue;
      const axis = (i) => (Math.abs(pad.axes[i] ?? 0) > DEAD ? pad.axes[i] : 0);
      wish[0] -= axis(1);
      wish[1] -= axis(0);
      wish[2] -= axis(2);
    }
    return wish.map((x) => Math.min(Math.max(x, -1), 1));
  }

  #steer() {
    if (!this.limits) return;
    const [lower, upper] = this.limits.velocity;
    const wish = document.body.dataset.mode === 'live' ? this.#wish() : [0, 0, 0];
    const velocity = wish.map((x, axis) => (x > 0 ? x * upper[axis] : x && -x * lower[axis]));
    const moving = velocity.some((x) => x !== 0);
    if (moving || this.moving) this.send({ type: 'walk', velocity });
    this.moving = moving;
  }
}

const UNITS = { friction: '', latency: ' ms', payload: ' kg', strength: ' N' };

function label(input) {
  const value = Number(input.value) * (input.id === 'latency' ? 1000 : 1);
  const digits = { friction: 2, payload: 1 }[input.id] ?? 0;
  input.parentElement.querySelector('output').textContent = value.toFixed(digits) + UNITS[input.id];
}
