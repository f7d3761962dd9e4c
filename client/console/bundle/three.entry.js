// What the page takes of three.js.
export {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, CapsuleGeometry, Color, DirectionalLight, DynamicDrawUsage,
  Float32BufferAttribute, Group, LineBasicMaterial, Line, LineLoop, LineSegments, Matrix4, Mesh, MeshLambertMaterial,
  MeshBasicMaterial, PerspectiveCamera, PlaneGeometry, Quaternion, Scene, SphereGeometry, Vector3, WebGLRenderer,
  DoubleSide,
} from "three";
export { OrbitControls } from "three/addons/controls/OrbitControls.js";
