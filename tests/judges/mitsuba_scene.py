"""Renders a benchmark scene with Mitsuba 3, an independent judge of the reference renderer.

    pip install mitsuba numpy
    python tests/judges/mitsuba_scene.py SCENE.json Ac|At|B SPP WIDTH HEIGHT OUT.npy [PICTURES [FIRST_SEED]]

Writes PICTURES (default 1) independent pictures, linear RGB float32 (pictures, h, w, 3), row 0 on top; several tell the
judge's own standard error (`compare.py`). The scalar variant needs nothing beside the wheel; MITSUBA_VARIANT=llvm_ad_rgb
is several times as fast where LLVM is installed (LLVM 15 could not select an instruction on a machine with AVX-512, LLVM 19
could; DRJIT_LIBLLVM_PATH names one), and cuda_ad_rgb on an H200 took 0.9 s for 79 million samples of Ac, where one core takes
some ninety with the scalar one. JUDGE_EVENTS sets how often a path scatters: 1 is direct light alone. Not part of any test run.
"""
import json
import os
import sys
import time

import mitsuba as mi
import numpy as np

mi.set_variant(os.environ.get('MITSUBA_VARIANT', 'scalar_rgb'))
S=json.load(open(sys.argv[1]))
variant=sys.argv[2]; spp=int(sys.argv[3]); W,H=int(sys.argv[4]),int(sys.argv[5])
e=S['elastomer']
nx,ny=e['nx'],e['ny']
x=np.linspace(-10,10,nx); y=np.linspace(-7.5,7.5,ny); X,Y=np.meshgrid(x,y)
r=np.hypot(X-e['cx'],Y-e['cy'])
Z=np.where(r<=e['rc'], e['d']-e['R']+np.sqrt(np.maximum(e['R']**2-r*r,0)), e['hc']*np.exp(-e['k']*(r-e['rc'])))
V=np.stack([X,Y,Z],-1).reshape(-1,3).astype(np.float32)
UV=np.stack([(X+10)/20,(Y+7.5)/15],-1).reshape(-1,2).astype(np.float32)
i,j=np.meshgrid(np.arange(nx-1),np.arange(ny-1)); a=(j*nx+i).ravel(); b=a+1; d=a+nx; c=d+1
F=np.concatenate([np.stack([a,b,c],1),np.stack([a,c,d],1)]).astype(np.uint32)
if variant=='At':
    u=(np.arange(640)+.5)/640; v=(np.arange(480)+.5)/480; U,Vv=np.meshgrid(u,v); tx=20*U-10; ty=15*Vv-7.5
    near=lambda t: t-(2*np.round((t-1)/2)+1)
    q=np.hypot(near(tx),near(ty)); m=1-.85*np.exp(-(q/.25)**4)
    T=np.stack([m*(.55+.15*np.sin(2*np.pi*tx/5)),m*(.5+.2*np.sin(2*np.pi*(tx+ty)/4)),m*(.45+.15*np.cos(2*np.pi*ty/3))],-1).astype(np.float32)
    refl={'type':'bitmap','bitmap':mi.Bitmap(T),'raw':True,'filter_type':'bilinear','wrap_mode':'clamp'}
else: refl={'type':'rgb','value':[.5]*3}
props=mi.Properties(); 
bs=mi.load_dict({'type':'twosided','b':{'type':'diffuse','reflectance':refl}})
props['mesh_bsdf']=bs
mesh=mi.Mesh('pad',len(V),len(F),has_vertex_texcoords=True,props=props)
p=mi.traverse(mesh)
p['vertex_positions']=V.ravel(); p['faces']=F.ravel(); p['vertex_texcoords']=UV.ravel(); p.update()
T=mi.ScalarTransform4f
grey={'type':'twosided','b':{'type':'diffuse','reflectance':{'type':'rgb','value':[.5]*3}}}
def rect(c,n,ud,su,vd,sv,emit=None):
    c,n,ud,vd=map(np.array,(c,n,ud,vd))
    if np.dot(np.cross(ud,vd),n)<0: ud=-ud
    M=np.eye(4); M[:3,0]=ud*su/2; M[:3,1]=vd*sv/2; M[:3,2]=n; M[:3,3]=c
    o={'type':'rectangle','to_world':T(M),'bsdf':grey}
    if emit: o['emitter']={'type':'area','radiance':{'type':'rgb','value':emit}}
    return o
sc={'type':'scene','pad':mesh,'integrator':{'type':'path','max_depth':1+int(os.environ.get('JUDGE_EVENTS',16 if variant=='B' else 8)),'rr_depth':1000}}
sc['w1']=rect([-10,0,9.75],[1,0,0],[0,1,0],15,[0,0,1],20.5); sc['w2']=rect([10,0,9.75],[-1,0,0],[0,1,0],15,[0,0,1],20.5)
sc['w3']=rect([0,-7.5,9.75],[0,1,0],[1,0,0],20,[0,0,1],20.5); sc['w4']=rect([0,7.5,9.75],[0,-1,0],[1,0,0],20,[0,0,1],20.5)
sc['ce']=rect([0,0,20],[0,0,-1],[1,0,0],20,[0,1,0],15)
for l in S['lights']: sc['l_'+l['name']]=rect(l['center_mm'],l['normal'],l['u_dir'],l['size_u_mm'],l['v_dir'],l['size_v_mm'],l['radiance_linear_rgb'])
if variant=='B':
    P=S['plate']; lo=np.array([P['x'][0],P['y'][0],P['z'][0]]); hi=np.array([P['x'][1],P['y'][1],P['z'][1]])
    M=np.eye(4); M[:3,:3]=np.diag((hi-lo)/2); M[:3,3]=(hi+lo)/2
    sc['plate']={'type':'cube','to_world':T(M),'bsdf':{'type':'dielectric','int_ior':P['ior'],'ext_ior':1.0}}
sc['cam']={'type':'perspective','fov':S['camera']['hfov_deg'],'fov_axis':'x','to_world':T().look_at(origin=[0,0,19],target=[0,0,0],up=[0,1,0]),'near_clip':.01,'film':{'type':'hdrfilm','width':W,'height':H,'rfilter':{'type':'box'},'pixel_format':'rgb','component_format':'float32'},'sampler':{'type':'multijitter','sample_count':spp}}
scene=mi.load_dict(sc)
pictures=[]
first=int(sys.argv[8]) if len(sys.argv)>8 else 0
for seed in range(first,first+(int(sys.argv[7]) if len(sys.argv)>7 else 1)):
    t=time.time(); img=np.array(mi.render(scene,spp=spp,seed=seed)).astype(np.float32); pictures.append(img)
    print(variant,seed,img.shape,'mean',img.mean((0,1)),'s',time.time()-t,flush=True)
    np.save(sys.argv[6],np.stack(pictures))
