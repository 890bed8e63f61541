// What `qv view` uses of three.js; esbuild leaves all else out where it can. See README.md.
export {
    AmbientLight, BufferAttribute, BufferGeometry, BoxGeometry, CapsuleGeometry, Color, CylinderGeometry, DataTexture,
    DirectionalLight, DoubleSide, FloatType, GridHelper, Group, InstancedBufferAttribute, InstancedBufferGeometry, InstancedMesh,
    Line, LineBasicMaterial, Matrix4, Mesh, MeshLambertMaterial, PerspectiveCamera, Quaternion, RGBAFormat, Scene,
    ShaderMaterial, SphereGeometry, Vector2, Vector3, WebGLRenderer, GLSL3, NormalBlending, CustomBlending, OneFactor,
    OneMinusSrcAlphaFactor,
} from 'three';
export { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
export { ConvexGeometry } from 'three/examples/jsm/geometries/ConvexGeometry.js';
