// Plots of rows over time, on canvases of their own.
import { colour } from './scene.js';

function size(canvas) {
  const scale = Math.min(devicePixelRatio, 2);
  const [width, height] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  return [width, height, scale];
}

function nice(x) {
  if (!Number.isFinite(x)) return '';
  return x.toFixed(Math.abs(x) < 10 ? 2 : 1);
}

// Up to two quantities over time. `seek` is told the time of a click.
export class Plot {
  constructor(figure, title, unit, names, seek) {
    const caption = document.createElement('figcaption');
    this.canvas = document.createElement('canvas');
    this.canvas.width = 0;
    this.title = title;
    this.label = document.createElement('b');
    this.unit(unit);
    this.values = document.createElement('span');
    caption.append(this.label, this.values);
    figure.append(caption, this.canvas);
    this.spans = names.map((name, index) => {
      const span = document.createElement('span');
      span.className = index ? 'of-second' : 'of-first';
      this.values.append(index ? ' ' : '', span);
      return Object.assign(span, { label: name });
    });
    this.canvas.addEventListener('pointerdown', (event) => {
      const share = event.offsetX / this.canvas.clientWidth;
      if (this.span) seek(this.span[0] + share * (this.span[1] - this.span[0]));
    });
  }

  unit(unit) {
    this.label.textContent = unit ? `${this.title}, ${unit}` : this.title;
  }

  // Draws the entries `columns` of `rows` from one time to another; `now` is the row of the cursor.
  draw(rows, columns, [from, to], now, live) {
    const [width, height, scale] = size(this.canvas);
    if (!width) return;
    this.span = [from, to];
    const pen = this.canvas.getContext('2d');
    pen.clearRect(0, 0, width, height);
    const [low, high] = this.#range(rows, columns, from, to);
    const x = (time) => width * (time - from) / (to - from);
    const y = (value) => height - scale * 3 - (height - scale * 6) * (value - low) / (high - low);
    pen.strokeStyle = colour('line');
    pen.lineWidth = scale;
    pen.beginPath();
    if (low < 0 && high > 0) {
      pen.moveTo(0, y(0));
      pen.lineTo(width, y(0));
    }
    pen.stroke();
    const step = Math.max(1, Math.floor(rows.length / (2 * width)));
    [...columns].reverse().forEach((column, index) => {
      const first = index === columns.length - 1;
      pen.strokeStyle = colour(first ? 'first' : 'second');
      pen.lineWidth = (first ? 1.6 : 1.2) * scale;
      pen.beginPath();
      let begun = false;
      for (let i = 0; i < rows.length; i += step) {
        const [time, value] = [rows[i][0], rows[i][column]];
        if (time < from || time > to || !Number.isFinite(value)) begun = false;
        else if (begun) pen.lineTo(x(time), y(value));
        else pen.moveTo(x(time), y(value));
        begun ||= time >= from && time <= to && Number.isFinite(value);
      }
      pen.stroke();
    });
    if (!live) cursor(pen, x(now[0]), height, scale);
    columns.forEach((column, index) => {
      const text = nice(now[column]);
      this.spans[index].textContent = text && `${this.spans[index].label} ${text}`;
    });
  }

  #range(rows, columns, from, to) {
    let [low, high] = [Infinity, -Infinity];
    for (const row of rows) {
      if (row[0] < from || row[0] > to) continue;
      for (const column of columns) {
        const value = row[column];
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    if (!(low <= high)) return [-1, 1];
    const middle = (low + high) / 2;
    const half = Math.max(0.55 * (high - low), 0.05);
    return [middle - half, middle + half];
  }
}

function cursor(pen, x, height, scale) {
  pen.strokeStyle = colour('soft');
  pen.lineWidth = scale;
  pen.beginPath();
  pen.moveTo(x, 0);
  pen.lineTo(x, height);
  pen.stroke();
}

// A bar for each foot while it is on the ground.
export class Gait extends Plot {
  draw(rows, columns, [from, to], now, live) {
    const [width, height, scale] = size(this.canvas);
    if (!width || !columns.length) return;
    this.span = [from, to];
    const pen = this.canvas.getContext('2d');
    pen.clearRect(0, 0, width, height);
    const x = (time) => width * (time - from) / (to - from);
    const lane = height / columns.length;
    columns.forEach((column, index) => {
      pen.fillStyle = colour(index % 2 ? 'second' : 'first');
      let since = null;
      const bar = (until) => {
        pen.fillRect(x(since), lane * index + 2 * scale, Math.max(1, x(until) - x(since)), lane - 4 * scale);
        since = null;
      };
      for (const row of rows) {
        if (row[0] < from || row[0] > to) continue;
        if (row[column] > 0.5) since ??= row[0];
        else if (since !== null) bar(row[0]);
      }
      if (since !== null) bar(Math.min(to, rows[rows.length - 1][0]));
    });
    if (!live) cursor(pen, x(now[0]), height, scale);
  }
}
