// The robot as three.js draws it: a group a link, turned by its joint.
import {
  BoxGeometry, CapsuleGeometry, Color, CylinderGeometry, Group, Mesh, MeshStandardMaterial, Quaternion, SphereGeometry, Vector3,
} from './three.js';

const BONE_RADIUS = 0.022;
// Bones shorter than this are within what they join, m.
const SHORTEST_BONE = 0.02;

// three's cylinders and capsules stand along y, those of a URDF along z.
function geometry({ kind, size }) {
  switch (kind) {
    case 'box': return new BoxGeometry(...size);
    case 'sphere': return new SphereGeometry(size[0], 24, 16);
    case 'cylinder': return new CylinderGeometry(size[0], size[0], size[1], 24).rotateX(Math.PI / 2);
    default: return new CapsuleGeometry(size[0], size[1], 6, 16).rotateX(Math.PI / 2);
  }
}

function place(object, [position, quaternion]) {
  object.position.set(...position);
  object.quaternion.set(...quaternion);
}

export class Robot extends Group {
  constructor(about) {
    super();
    this.about = about;
    this.field = Object.fromEntries(about.fields.map((name, index) => [name, index]));
    this.materials = Object.fromEntries(['trunk', 'bone', 'first', 'second'].map(
      (name) => [name, new MeshStandardMaterial({ roughness: 0.65, metalness: 0.05 })],
    ));
    this.groups = about.links.map(() => new Group());
    this.add(this.groups[0]);
    const material = this.#materialOfLinks();
    about.links.forEach((link, index) => {
      link.shapes.forEach((shape) => this.#mesh(this.groups[index], geometry(shape), material[index], shape.pose));
    });
    this.joints = about.joints.map((joint) => {
      const frame = new Group();
      place(frame, joint.origin);
      frame.add(this.groups[joint.child]);
      this.groups[joint.parent].add(frame);
      this.#bone(this.groups[joint.parent], frame.position);
      return { ...joint, axis: new Vector3(...joint.axis), group: this.groups[joint.child] };
    });
  }

  // Everything from the base to a foot has that foot's colour.
  #materialOfLinks() {
    const material = this.about.links.map(() => this.materials.trunk);
    this.about.feet.forEach((foot, index) => {
      for (let link = foot.link; link > 0; link = this.about.links[link].parent) {
        material[link] = index % 2 ? this.materials.second : this.materials.first;
      }
    });
    return material;
  }

  #mesh(group, shape, material, pose) {
    const mesh = new Mesh(shape, material);
    place(mesh, pose);
    mesh.castShadow = true;
    mesh.receiveShadow = true;
    group.add(mesh);
  }

  #bone(group, end) {
    const length = end.length();
    if (length < SHORTEST_BONE) return;
    const turn = new Quaternion().setFromUnitVectors(new Vector3(0, 1, 0), end.clone().divideScalar(length));
    this.#mesh(group, new CapsuleGeometry(BONE_RADIUS, length, 4, 12), this.materials.bone, [
      end.clone().multiplyScalar(0.5).toArray(), turn.toArray(),
    ]);
  }

  paint(colour) {
    for (const [name, material] of Object.entries(this.materials)) material.color = new Color(colour(name));
  }

  // Takes the pose of a row.
  show(row) {
    const at = (name) => row[this.field[name]];
    const base = this.groups[0];
    base.position.set(at('x'), at('y'), at('z'));
    base.quaternion.set(at('qx'), at('qy'), at('qz'), at('qw'));
    const first = this.field[`position/${this.about.dofs[0]}`];
    for (const joint of this.joints) {
      const position = joint.multiplier * row[first + joint.dof] + joint.offset;
      if (joint.slides) joint.group.position.copy(joint.axis).multiplyScalar(position);
      else joint.group.quaternion.setFromAxisAngle(joint.axis, position);
    }
  }
}
