// Light, ground, camera, and the arrow of a push.
import {
  ArrowHelper, CanvasTexture, Color, DirectionalLight, Fog, HemisphereLight, Mesh, MeshStandardMaterial, OrbitControls,
  PCFShadowMap, PerspectiveCamera, PlaneGeometry, Raycaster, RepeatWrapping, SRGBColorSpace, Scene, Vector2, Vector3, WebGLRenderer,
} from './three.js';

const GROUND = 40; // m
const UP = new Vector3(0, 0, 1);
const ARROW = 0.01; // m per N

export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

// One metre: a strong line around it and a weak one across each half.
function tile() {
  const size = 256;
  const canvas = Object.assign(document.createElement('canvas'), { width: size, height: size });
  const pen = canvas.getContext('2d');
  pen.fillStyle = colour('floor');
  pen.fillRect(0, 0, size, size);
  pen.fillStyle = colour('mark');
  for (const [at, width] of [[0, 4], [size / 2, 1.5]]) {
    pen.fillRect(at - width / 2, 0, width, size);
    pen.fillRect(0, at - width / 2, size, width);
  }
  pen.fillRect(size - 2, 0, 2, size);
  pen.fillRect(0, size - 2, size, 2);
  const texture = new CanvasTexture(canvas);
  texture.wrapS = RepeatWrapping;
  texture.wrapT = RepeatWrapping;
  texture.repeat.set(GROUND, GROUND);
  texture.anisotropy = 8;
  texture.colorSpace = SRGBColorSpace;
  return texture;
}

export class Stage {
  constructor(canvas, robot) {
    this.canvas = canvas;
    this.robot = robot;
    this.renderer = new WebGLRenderer({ canvas, antialias: true });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(38, 1, 0.05, 60);
    this.camera.up.copy(UP);
    const height = Math.max(0.3, robot.about.height);
    this.focus = new Vector3(0, 0, 0.7 * height);
    this.camera.position.set(2.2, -3.3, 1.0).multiplyScalar(height).add(this.focus);
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.target.copy(this.focus);
    this.controls.enablePan = false;
    this.controls.minDistance = 0.5 * height;
    this.controls.maxDistance = 12 * height;
    this.controls.maxPolarAngle = 0.497 * Math.PI;
    this.#build(height);
    this.#paint();
    matchMedia('(prefers-color-scheme: dark)').addEventListener('change', () => this.#paint());
    new ResizeObserver(() => this.#resize()).observe(canvas);
    this.#resize();
  }

  #build(height) {
    this.ground = new Mesh(new PlaneGeometry(GROUND, GROUND), new MeshStandardMaterial({ roughness: 1 }));
    this.ground.receiveShadow = true;
    this.sky = new HemisphereLight(0xffffff, 0x8a94a3, 1.7);
    this.sky.position.set(0, 0, 1);
    this.sun = new DirectionalLight(0xffffff, 2.2);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    this.sun.shadow.bias = -0.0005;
    this.sun.shadow.normalBias = 0.01;
    const reach = 1.6 * height;
    Object.assign(this.sun.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.1, far: 8 * height });
    this.sunward = new Vector3(1.2, -1.6, 3).multiplyScalar(height);
    this.arrow = new ArrowHelper(new Vector3(1, 0, 0), new Vector3(), 1, 0xc53030, 0.12, 0.08);
    this.arrow.visible = false;
    this.scene.add(this.ground, this.sky, this.sun, this.sun.target, this.robot, this.arrow);
  }

  #paint() {
    const sky = new Color(colour('sky'));
    this.scene.background = sky;
    this.scene.fog = new Fog(sky, 6, 18);
    this.ground.material.map?.dispose();
    this.ground.material.map = tile();
    this.ground.material.needsUpdate = true;
    this.arrow.setColor(new Color(colour('bad')));
    this.robot.paint(colour);
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    // A narrow screen sees as much across as a wide one.
    this.camera.fov = width < height ? 52 : 38;
    // Beside the panel, and above what is at the bottom.
    const panel = matchMedia('(max-width: 760px)').matches ? 0 : 312;
    this.camera.setViewOffset(width, height, panel / 2, 0, width, height);
    this.camera.updateProjectionMatrix();
  }

  // Shows a row; the camera goes along.
  show(row) {
    this.robot.show(row);
    const { field } = this.robot;
    const here = new Vector3(row[field.x], row[field.y], this.focus.z);
    const moved = here.clone().sub(this.focus);
    this.camera.position.add(moved);
    this.controls.target.add(moved);
    this.focus.copy(here);
    this.ground.position.set(Math.round(here.x), Math.round(here.y), 0);
    this.sun.target.position.set(here.x, here.y, 0);
    this.sun.position.copy(this.sun.target.position).add(this.sunward);
    const push = new Vector3(row[field.push_x], row[field.push_y], 0);
    const force = push.length();
    this.arrow.visible = force > 0;
    if (force > 0) {
      const direction = push.divideScalar(force);
      const length = Math.max(0.15, ARROW * force);
      this.arrow.setDirection(direction);
      this.arrow.setLength(length, 0.12, 0.08);
      this.arrow.position.set(here.x, here.y, row[field.z] + 0.1).addScaledVector(direction, -length - 0.1);
    }
  }

  draw() {
    this.controls.update();
    this.renderer.render(this.scene, this.camera);
  }

  // Whether the robot is at this place of the window.
  isRobotAt(x, y) {
    const box = this.canvas.getBoundingClientRect();
    const at = new Vector2(2 * (x - box.left) / box.width - 1, 1 - 2 * (y - box.top) / box.height);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.camera);
    return ray.intersectObject(this.robot, true).length > 0;
  }

  // Horizontal unit vector in which the camera looks.
  ahead() {
    const ahead = this.camera.getWorldDirection(new Vector3());
    return ahead.setZ(0).normalize();
  }
}
