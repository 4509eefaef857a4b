// Puts the page together: asks for the robot and its logs, shows what is chosen.
import { Driver } from './driver.js';
import { Gait, Plot } from './plots.js';
import { Player } from './player.js';
import { Robot } from './robot.js';
import { Stage } from './scene.js';

const LIVE_SECONDS = 6;
// Plots are drawn this often, ms: the robot comes first.
const PLOT_PERIOD = 100;

const element = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get('token') ?? '';

function address(path) {
  return `/api/${path}?token=${encodeURIComponent(token)}`;
}

async function get(path) {
  const response = await fetch(address(path));
  if (!response.ok) throw new Error((await response.text()).trim());
  return response;
}
get.address = address;

function say(text, kind = '') {
  element('state').textContent = text;
  element('state').className = kind;
}

class Page {
  constructor(about, names) {
    this.robot = new Robot(about);
    this.stage = new Stage(element('scene'), this.robot);
    this.field = this.robot.field;
    this.live = [];
    this.row = null;
    this.plotted = 0;
    element('name').textContent = about.name;
    this.player = new Player(get, (row) => this.show(row));
    this.#plots(about);
    this.#sources(names);
    element('details').addEventListener('click', () => {
      const open = element('panel').classList.toggle('open');
      element('details').setAttribute('aria-expanded', open);
    });
    this.last = performance.now();
    requestAnimationFrame((now) => this.#frame(now));
  }

  drive() {
    const live = { onRow: (row) => this.#hear(row), onReport: (report) => this.#report(report), onTrouble: (why) => this.#warn(why) };
    const socket = new URL(address('drive'), location.href);
    socket.protocol = socket.protocol.replace('http', 'ws');
    this.driver = new Driver(socket, this.stage, live);
  }

  #plots(about) {
    const seek = (time) => {
      if (document.body.dataset.mode !== 'clip') return;
      this.player.pause();
      this.player.seek(time);
    };
    const plot = (id, title, unit, names, kind = Plot) => new kind(element(`plot-${id}`), title, unit, names, seek);
    this.plots = {
      speed: plot('speed', 'forward', 'm/s', ['is', 'told']),
      feet: plot('feet', 'feet on the ground', '', [], Gait),
      position: plot('position', 'position', 'rad', ['is', 'told']),
      velocity: plot('velocity', 'velocity', 'rad/s', ['']),
      effort: plot('effort', 'torque', 'N m', ['']),
    };
    about.dofs.forEach((name) => element('joint').add(new Option(name.replaceAll('_', ' '), name)));
    element('joint').addEventListener('change', () => this.#units());
    const knee = about.dofs.find((name) => name.includes('knee'));
    if (knee) element('joint').value = knee;
    this.#units();
  }

  // A joint turns or slides.
  #units() {
    const joint = this.robot.about.joints.find(({ name }) => name === element('joint').value);
    const [way, force] = joint?.slides ? ['m', 'N'] : ['rad', 'N m'];
    this.plots.position.unit(way);
    this.plots.velocity.unit(`${way}/s`);
    this.plots.effort.unit(force);
  }

  #sources(names) {
    this.source = element('source');
    this.source.addEventListener('change', () => {
      this.choose(this.source.value);
      this.source.blur();
    });
    this.clips = 0;
    this.#offer(names);
  }

  #offer(names) {
    names.slice(this.clips).forEach((name, i) => this.source.add(new Option(name, String(this.clips + i))));
    this.clips = names.length;
  }

  async choose(source) {
    const live = source === 'live';
    document.body.dataset.mode = live ? 'live' : 'clip';
    this.source.value = source;
    this.player.pause();
    if (live) return;
    say('loading');
    try {
      await this.player.open(Number(source), this.robot.about.fields.length);
      say('');
    } catch (error) {
      say(error.message, 'bad');
    }
  }

  #hear(row) {
    this.live.push(row);
    while (this.live[0][0] < row[0] - LIVE_SECONDS || this.live[0][0] > row[0]) this.live.shift();
    if (document.body.dataset.mode === 'live') this.show(row);
  }

  async #report(report) {
    if (document.body.dataset.mode === 'live') {
      const falls = report.falls ? `, ${report.falls} ${report.falls === 1 ? 'fall' : 'falls'}` : '';
      const slow = report.pace < 0.9 ? `, at ${report.pace.toFixed(1)}× speed` : '';
      if (report.trouble) say(report.trouble, 'bad');
      else say((report.fault ?? report.mode) + falls + slow, report.fault ? 'bad' : 'good');
    }
    if (report.clips > this.clips) {
      this.#offer(await (await get('clips')).json());
    }
  }

  #warn(why) {
    if (document.body.dataset.mode === 'live') say(why, 'bad');
  }

  show(row) {
    this.row = row;
  }

  #frame(now) {
    const elapsed = Math.min(0.25, (now - this.last) / 1000);
    this.last = now;
    if (document.body.dataset.mode === 'clip') this.player.advance(elapsed);
    if (this.row) {
      this.stage.show(this.row);
      if (now - this.plotted > PLOT_PERIOD) {
        this.plotted = now;
        this.#read();
      }
    }
    this.stage.draw();
    requestAnimationFrame((next) => this.#frame(next));
  }

  // Readings and plots of the row that is shown.
  #read() {
    const { row, field } = this;
    const live = document.body.dataset.mode === 'live';
    const number = (name) => row[field[name]].toFixed(2);
    element('forward').textContent = number('velocity_x');
    element('left').textContent = number('velocity_y');
    element('turn').textContent = number('velocity_turn');
    element('place').textContent = `${number('x')}, ${number('y')}`;
    const rows = live ? this.live : this.player.rows;
    if (!rows.length) return;
    const span = live ? [row[0] - LIVE_SECONDS, row[0]] : [0, Math.max(0.1, this.player.seconds)];
    const joint = element('joint').value;
    const of = (...names) => names.map((name) => field[name]);
    const columns = {
      speed: of('velocity_x', 'command_x'),
      feet: this.robot.about.feet.map((foot) => field[`contact/${foot.name}`]),
      position: of(`position/${joint}`, `target/${joint}`),
      velocity: of(`velocity/${joint}`),
      effort: of(`effort/${joint}`),
    };
    for (const [name, plot] of Object.entries(this.plots)) plot.draw(rows, columns[name], span, row, live);
  }
}

async function start() {
  try {
    const [about, offer] = await Promise.all([get('robot'), get('clips')].map(async (answer) => (await answer).json()));
    const page = new Page(about, offer);
    if (about.drives) {
      page.source.add(new Option('Live', 'live'), 0);
      page.drive();
    }
    await page.choose(about.drives ? 'live' : '0');
  } catch (error) {
    say(error.message, 'bad');
    throw error;
  }
}

start();
