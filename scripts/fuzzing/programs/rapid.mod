MODULE Cell(SYSMODULE, NOSTEPIN)
  ! a comment with a "quote and MoveL p99,v100,fine,tNone; and a bracket [
  PERS tooldata tGrip:=[TRUE,[[10,0,120.5],[0.7071068,0,0.7071068,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];
  TASK PERS wobjdata wFix:=[FALSE,TRUE,"",[[800,0,500],[1,0,0,0]],[[10,20,30],[1,0,0,0]]];
  CONST robtarget p10:=[[100,50,200],[0,0,1,0],[0,0,0,0],[9E9,9E+09,9E9,9E9,9E9,9E9]]; ! behind
  CONST robtarget pRow{2}:=[[[900,0,800],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],
    [[950,50,800],[0.1,0,0.99498744,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]];
  VAR jointtarget jHome:=[[10,10,-20,30.25,40,-90],[9E9,9E9,9E9,9E9,9E9,9E9]];
  CONST string text:="a ""quoted"" ; MoveL p98";
  PROC main(\switch on, num n)
    MoveAbsJ jHome\NoEOffs,v100,fine,tool0;
    IF n>3 MoveL \Conc, p10, v100\T:=5, z10 \Inpos:=inpos50, tGrip \WObj:=wFix;
    GripLoad [3,[0,5,20],[1,0,0,0],0,0,0];
    FOR i FROM 1 TO 2 DO MoveL pRow{i},v100,z10,tool0; ENDFOR
    MoveC [[920,10,820],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]],pRow{1},v100,z1,tool0;
    MoveL Offs(p10,0,0,10),v100,z10,tGrip\WObj:=wFix;
  ENDPROC
ENDMODULE
